// Loops over the bins of a spectrum, for one instruction set (whittle_kernel.cpp). The loops process numbers
// in packs, each of which is a vector register.
#pragma once

#include <cstddef>

#include "pack_math.hpp"

namespace fltea {
namespace noise_models {
inline namespace FLTEA_INSTRUCTION_SET {

typedef engine::Pack<double, engine::kWidth> Wide;

template <class T>
inline T from(const double* at) {
    T found;
    __builtin_memcpy(&found, at, sizeof found);
    return found;
}
template <class T>
inline void to(double* at, T value) {
    __builtin_memcpy(at, &value, sizeof value);
}

// Calls `op` for all bins. op(Wide(), i) processes as many bins from i on as there are numbers in a pack (a
// vector register). op(double(), i) processes bin i alone; it is called for the last few bins. The result for
// a bin is the same in both cases (pack_math.hpp). Packs are used explicitly, because compilers do not
// vectorise exp.
template <class Op>
__attribute__((always_inline)) inline void each(std::size_t size, Op op) {
    std::size_t i = 0;
    for (; i + engine::kWidth <= size; i += engine::kWidth) op(Wide(), i);
    for (; i < size; ++i) op(double(), i);
}

// Computes kSums sums over all bins. `term` computes the terms of one bin, or of as many bins as there are
// numbers in a pack. Each sum is computed as eight partial sums, however many numbers a pack has. The result
// is therefore the same for all instruction sets.
template <int kSums, class Term>
__attribute__((always_inline)) inline void sums_of(std::size_t size, Term term, double* found) {
    constexpr std::size_t kPacks = 8 / engine::kWidth;
    Wide packs[kSums][kPacks];
    for (auto& row : packs)
        for (Wide& one : row) one = Wide(0.0);
    std::size_t i = 0;
    for (; i + 8 <= size; i += 8)
#pragma GCC unroll 8
        for (std::size_t k = 0; k < kPacks; ++k) {
            Wide terms[kSums];
            term(terms, i + k * engine::kWidth);
#pragma GCC unroll 8
            for (int j = 0; j < kSums; ++j) packs[j][k] += terms[j];
        }
    double lane[kSums][8];
    __builtin_memcpy(lane, packs, sizeof lane);
    for (; i < size; ++i) {
        double terms[kSums];
        term(terms, i);
        for (int j = 0; j < kSums; ++j) lane[j][i % 8] += terms[j];
    }
    for (int j = 0; j < kSums; ++j)
        found[j] = ((lane[j][0] + lane[j][4]) + (lane[j][1] + lane[j][5])) +
                   ((lane[j][2] + lane[j][6]) + (lane[j][3] + lane[j][7]));
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace noise_models
}  // namespace fltea
