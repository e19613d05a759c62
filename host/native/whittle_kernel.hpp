// The sums over the bins of a spectrum that a Whittle fit needs: plain data and one table of functions per
// instruction set (whittle_kernel.cpp is compiled once for each, as engine.hpp says of the engine). Nothing
// in this file is code. The caller owns all memory.
#pragma once

#include <cstddef>

#include "whittle_numbers.hpp"

namespace fltea {
namespace whittle {

const int kMostParts = Room<double>::kParts;
const std::size_t kPadding = 8;  // the number of bins is a multiple of it

// What does not depend on the parameters. Bins that fill up to the multiple have the count 0.
struct Bins {
    std::size_t size;
    const double* counts;   // ordinates in each
    const double* ln_size;  // log |1 - e^{-iλ}|
    const double* quarter;  // (π - λ) / 2
    const double* turn;     // λ
    const double* cos1;     // cos λ, sin λ, cos 2λ, sin 2λ
    const double* sin1;
    const double* cos2;
    const double* sin2;
    const double* square;  // |1 - e^{-iλ}|²
};

struct Kernel {
    const char* name;
    void (*sums)(Family family, const Bins& bins, const double* power, const Natural<double>& at,
                 Sums<double>& out);
    // Σ c log S, and Σ c r for each of `series` rows of powers, of a spectrum. `parts` (kMostParts * bins) is
    // where the parts' spectra are kept: `same` says that they are there already, of the same shapes.
    double (*ratios)(Family family, const Bins& bins, const double* power, std::size_t series,
                     const Natural<double>& at, bool same, double* parts, double* ratio);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

}  // namespace whittle
}  // namespace fltea
