// The numbers of a fitted spectrum, and the sums over its bins that a Whittle fit needs, as plain data.
#ifndef FLTEA_WHITTLE_NUMBERS_HPP
#define FLTEA_WHITTLE_NUMBERS_HPP

namespace fltea {
namespace whittle {

// A spectrum consists of parts, each with a variance, and of white noise of variance R. The parts have unit
// innovations, except a low-pass, which has the gain 1 at frequency 0.
enum Family : int {
    kWhite,
    kFractional,
    kAr1,  // sums of one to six AR(1), except kAr2
    kAr2,
    kTwoAr1,
    kThreeAr1,
    kFourAr1,
    kFiveAr1,
    kSixAr1,
    kLowPass,  // low-pass filtered white noise, and up to two AR(1)
    kLowPassAr1,
    kLowPassTwoAr1,
    kArfima,  // AR(1) driven by fractionally differenced noise instead of white noise
    kRising,  // |1 - e^{-iλ}|^2δ: fractional differences
    kFamilies
};

// Array sizes for each number type: shapes (the numbers that determine the shapes of the parts: α and g, or
// the poles), parts in addition to white noise, and free parameters.
template <class R>
struct Room {
    enum { kShapes = 6, kParts = 6, kFree = 12 };
    // -log L where there is no spectrum.
    static constexpr R impossible() { return 1e300; }
};
// The board fits the fractional model and AR(1).
template <>
struct Room<float> {
    enum { kShapes = 2, kParts = 1, kFree = 3 };
    static constexpr float impossible() { return 1e30f; }
};
// Largest number of all numbers of a spectrum.
template <class R>
struct Most {
    enum { kNumbers = Room<R>::kShapes + Room<R>::kParts + 1 };
};

// Numbers of a spectrum. Shapes: α, g of the fractional model; d, φ of ARFIMA; φ1, φ2 of AR(2); the φ of sums
// of AR(1); log c and n of a low-pass 1 / (1 + (λ²/c)^n), followed by the φ; δ of kRising. Then the variances
// of the parts, and R.
template <class R>
struct Natural {
    R shape[Room<R>::kShapes];
    R variance[Room<R>::kParts];
    R white;
};

// Sums over the bins. r = I/S, and D are the (shapes + parts + 1) derivatives of log S by the shapes, by the
// logarithms of the variances, and by that of R, in this order:
template <class R>
struct Sums {
    enum { kMost = Most<R>::kNumbers };

    R log_spectrum;          // Σ c log S
    R ratio;                 // Σ c r
    R slope[kMost];          // Σ c D
    R weighted[kMost];       // Σ c r D
    R square[kMost][kMost];  // Σ c D Dᵀ; only the lower triangle is filled
};

inline bool low_pass(Family family) { return family >= kLowPass && family < kArfima; }
// Number of AR(1) in a family.
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
