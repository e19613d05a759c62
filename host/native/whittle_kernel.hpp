// The sums over the bins of a spectrum that a Whittle fit needs: plain data and one table of functions per
// instruction set (whittle_kernel.cpp is compiled once for each, as engine.hpp says of the engine). Nothing
// in this file is code. The caller owns all memory.
#pragma once

#include <cstddef>

namespace fltea {
namespace whittle {

// A spectrum is made of parts, each with a variance, and of white noise of variance R. Parts are of unit
// innovations, but a low-pass has the gain 1 at frequency 0.
enum Family : int {
    kWhite,
    kFractional,
    kAr1,  // sums of one to six AR(1), but for kAr2
    kAr2,
    kTwoAr1,
    kThreeAr1,
    kFourAr1,
    kFiveAr1,
    kSixAr1,
    kLowPass,  // white noise through a low-pass, and none to two AR(1)
    kLowPassAr1,
    kLowPassTwoAr1,
    kArfima,  // AR(1) of which a difference of a fractional order, not of white noise, is the cause
    kRising,  // |1 - e^{-iλ}|^2δ: differences of a fractional order
    kFamilies
};

const int kMostShapes = 6;  // numbers that give the parts their shapes: α and g, or the poles
const int kMostParts = 6;   // besides white noise
const int kMost = kMostShapes + kMostParts + 1;  // all numbers of a spectrum
const std::size_t kPadding = 8;                  // the number of bins is a multiple of it

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

// Numbers of a spectrum: fractional α, g; ARFIMA d, φ; AR(2) φ1, φ2; sums of AR(1) their φ; a low-pass log c
// and n of 1 / (1 + (λ²/c)^n), then the φ; rising δ. Then the variances of the parts, and R.
struct Natural {
    double shape[kMostShapes];
    double variance[kMostParts];
    double white;
};

// With r = I/S and the slopes D of log S by the shapes, the logarithms of the variances and that of R, in
// this order, (shapes + parts + 1) of them:
struct Sums {
    double log_spectrum;          // Σ c log S
    double ratio;                 // Σ c r
    double slope[kMost];          // Σ c D
    double weighted[kMost];       // Σ c r D
    double square[kMost][kMost];  // Σ c D Dᵀ, of which the lower triangle is filled
};

struct Kernel {
    const char* name;
    void (*sums)(Family family, const Bins& bins, const double* power, const Natural& at, Sums& out);
    // Σ c log S, and Σ c r for each of `series` rows of powers, of a spectrum. `parts` (kMostParts * bins) is
    // where the parts' spectra are kept: `same` says that they are there already, of the same shapes.
    double (*ratios)(Family family, const Bins& bins, const double* power, std::size_t series,
                     const Natural& at, bool same, double* parts, double* ratio);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

inline bool low_pass(Family family) { return family >= kLowPass && family < kArfima; }
// AR(1) in it.
inline int poles(Family family) {
    switch (family) {
        case kAr1:
            return 1;
        case kWhite:
        case kFractional:
        case kAr2:
        case kArfima:
        case kRising:
            return 0;
        default:
            return low_pass(family) ? family - kLowPass : family - kTwoAr1 + 2;
    }
}
inline int shapes(Family family) {
    if (family == kFractional || family == kAr2 || family == kArfima) return 2;
    return family == kRising ? 1 : poles(family) + (low_pass(family) ? 2 : 0);
}
inline int parts(Family family) {
    if (family == kFractional || family == kAr2 || family >= kArfima) return 1;
    return poles(family) + (low_pass(family) ? 1 : 0);
}

}  // namespace whittle
}  // namespace fltea
