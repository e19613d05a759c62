// The name of the instruction set for which this file is compiled. The inline namespace of the engine has
// this name (see pack.hpp for the reason).
#ifndef FLTEA_INSTRUCTION_SET_HPP
#define FLTEA_INSTRUCTION_SET_HPP

#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__FMA__)
#define FLTEA_INSTRUCTION_SET avx512
#elif defined(__AVX2__) && defined(__FMA__)
#define FLTEA_INSTRUCTION_SET avx2
#else
#define FLTEA_INSTRUCTION_SET baseline
#endif

#endif
