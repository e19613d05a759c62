// The numbers of a fitted spectrum, and the sums over its bins that a Whittle fit needs, as structures of
// plain data.
#ifndef FLTEA_WHITTLE_NUMBERS_HPP
#define FLTEA_WHITTLE_NUMBERS_HPP

namespace fltea {
namespace whittle {

// The families of spectra. A spectrum is the sum of the spectra of its parts, and of white noise of variance
// R. The spectrum of a part is a variance times a spectrum of fixed scale. For a low-pass, the latter is 1 at
// frequency 0. For any other part, it is the spectrum if the white noise that drives the part has variance 1.
enum Family : int {
    kWhite,
    kFractional,
    kAr1,  // kAr1, kTwoAr1 ... kSixAr1: sums of one to six AR(1); kAr2: an AR(2)
    kAr2,
    kTwoAr1,
    kThreeAr1,
    kFourAr1,
    kFiveAr1,
    kSixAr1,
    kLowPass,  // kLowPass...: low-pass filtered white noise, alone or plus one or two AR(1)
    kLowPassAr1,
    kLowPassTwoAr1,
    kArfima,  // AR(1) driven by fractionally differenced noise instead of white noise
    kRising,  // white noise differenced δ times (δ may be a fraction): |1 - e^{-iλ}|^2δ
    kFamilies
};

// Sizes of the arrays in Natural, for the number type R. kShapes: the numbers that determine the form of a
// spectrum, such as an order. kParts: parts in addition to white noise. kFree: free
// parameters of a fit.
template <class R>
struct Room {
    enum { kShapes = 6, kParts = 6, kFree = 12 };
    // Returns the number that stands for -log L (L: likelihood) if the parameters give no valid spectrum.
    static constexpr R impossible() { return 1e300; }
};
// The array sizes for float, the number type on the board, which fits only the fractional model and AR(1).
template <>
struct Room<float> {
    enum { kShapes = 2, kParts = 1, kFree = 3 };
    static constexpr float impossible() { return 1e30f; }
};
// Largest count of the numbers that determine a spectrum: shapes, variances of the parts, and R.
template <class R>
struct Most {
    enum { kNumbers = Room<R>::kShapes + Room<R>::kParts + 1 };
};

// What determines a spectrum: the variances of its parts, the variance `white` of the white noise, and the
// numbers `shape`, which determine the form. For each family, `shape` contains:
//   fractional model: order α, feedback g
//   ARFIMA: order d, coefficient φ
//   AR(2): coefficients φ1 and φ2
//   sum of AR(1): the coefficient φ of each
//   low-pass 1 / (1 + (λ²/c)^n) at the frequency λ: log c, n, and the φ of each AR(1) that is added
//   noise that rises with the frequency: exponent δ
template <class R>
struct Natural {
    R shape[Room<R>::kShapes];
    R variance[Room<R>::kParts];
    R white;
};

// Sums over the bins of a periodogram. A bin is the mean I of c neighbouring values (ordinates) of the
// periodogram. S is the model's spectrum in the bin, and r = I/S. D is the vector of the derivatives of log S
// by the numbers in `Natural`: first by `shape`, then by the logarithms of the parts' variances, and last by
// the logarithm of the white noise's variance.
template <class R>
struct Sums {
    enum { kMost = Most<R>::kNumbers };

    R log_spectrum;     // Σ c log S, with the letters of the comment on Sums
    R ratio;            // Σ c r
    R slope[kMost];     // Σ c D
    R weighted[kMost];  // Σ c r D
    // Σ c D Dᵀ, with the letters of the comment on Sums; only the lower triangle is filled
    R square[kMost][kMost];
};

inline bool low_pass(Family family) { return family >= kLowPass && family < kArfima; }
// Returns the number of AR(1) parts in the spectra of a family.
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

#endif
