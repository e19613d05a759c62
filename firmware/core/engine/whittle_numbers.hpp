// What a spectrum that is fitted is made of, and the sums over its bins that a Whittle fit needs: plain data.
#ifndef FLTEA_WHITTLE_NUMBERS_HPP
#define FLTEA_WHITTLE_NUMBERS_HPP

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

// How much room there is, by the type of the numbers: shapes (numbers that give the parts their shapes: α and
// g, or the poles), parts besides white noise, coordinates.
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
// All numbers of a spectrum.
template <class R>
struct Most {
    enum { kNumbers = Room<R>::kShapes + Room<R>::kParts + 1 };
};

// Numbers of a spectrum: fractional α, g; ARFIMA d, φ; AR(2) φ1, φ2; sums of AR(1) their φ; a low-pass log c
// and n of 1 / (1 + (λ²/c)^n), then the φ; rising δ. Then the variances of the parts, and R.
template <class R>
struct Natural {
    R shape[Room<R>::kShapes];
    R variance[Room<R>::kParts];
    R white;
};

// With r = I/S and the slopes D of log S by the shapes, the logarithms of the variances and that of R, in
// this order, (shapes + parts + 1) of them:
template <class R>
struct Sums {
    enum { kMost = Most<R>::kNumbers };

    R log_spectrum;          // Σ c log S
    R ratio;                 // Σ c r
    R slope[kMost];          // Σ c D
    R weighted[kMost];       // Σ c r D
    R square[kMost][kMost];  // Σ c D Dᵀ, of which the lower triangle is filled
};

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

#endif
