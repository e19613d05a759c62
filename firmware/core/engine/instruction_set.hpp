// The name of the instruction set that this file is compiled for, and of the inline namespace that all of the
// engine lives in (pack.hpp says why).
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
