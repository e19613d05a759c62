// FLTEA_INSTRUCTION_SET is the name of the instruction set for which a file is compiled. The engine's code is
// in an inline namespace of this name (pack.hpp says why).
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
