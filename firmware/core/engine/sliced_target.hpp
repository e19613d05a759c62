// The sums of a fit in float over a few bins at a time: the device's.
//
// -log L is kept as its excess over that of a spectrum that is the data themselves, Σ c (r - 1 - log r) with
// r = I/S: a number like that of the bins, while -log L itself is like that of the ordinates, of which float
// would lose the digits that count.
#ifndef FLTEA_SLICED_TARGET_HPP
#define FLTEA_SLICED_TARGET_HPP

#include <cstddef>

#include "real_math.hpp"
#include "whittle_shapes.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// u - log(1 + u), u > -1, without cancellation.
inline float excess(float u) {
    if (u > 0.25f || u < -0.25f) return u - math::log(1.0f + u);
    float sum = 1.0f / 11.0f;
    for (int k = 10; k >= 2; --k) sum = 1.0f / static_cast<float>(k) - u * sum;
    return u * u * sum;
}

struct ExcessLikelihood {
    static float term(float count, float, float power, float inverse) {
        // Of a bin without power the logarithm is that of the smallest number.
        const float u = power * inverse - 1.0f;
        return count * excess(u > -0.9999999f ? u : -0.9999999f);
    }
};

// What the bins (fit_bins.hpp) are for the shapes.
template <class Bins>
struct BinColumns {
    const Bins& bins;
    float counts(std::size_t i) const { return bins.counts(static_cast<int>(i)); }
    float ln_size(std::size_t i) const { return bins.ln_size(static_cast<int>(i)); }
    float turn(std::size_t i) const { return bins.lam(static_cast<int>(i)); }
    float quarter(std::size_t i) const { return 0.5f * (3.14159265f - turn(i)); }
    float square(std::size_t i) const { return math::exp(2.0f * ln_size(i)); }
};

// Spectra over bins whose powers are divided by `unit`; S is told apart from `reference` S.
template <class Bins>
class SlicedTarget {
  public:
    float ordinates;

    void begin(const Bins& bins) {
        ordinates = bins.ordinates();
        over_unit_ = 1.0f / bins.mean_power();
        reference_ = 1.0f;
    }
    void refer_to(float scale) { reference_ = scale; }
    float reference() const { return reference_; }
    float unit() const { return 1.0f / over_unit_; }

    // An evaluation: begin it, then add bins from `at` on, up to so many, until none is left.
    void begin_sums() {
        at_ = 0;
        fractional_ = RunningSums<float, 4>();
        relaxation_ = RunningSums<float, 3>();
        white_ = RunningSums<float, 1>();
    }
    bool add(const Bins& bins, Family family, const Natural<float>& natural, int most) {
        switch (family) {
            case kWhite:
                return add(White<float>(natural), bins, natural, most, white_);
            case kAr1:
                return add(Relaxations<float, 1>(natural), bins, natural, most, relaxation_);
            default:
                return add(Fractional<float>(natural), bins, natural, most, fractional_);
        }
    }
    void read(Family family, Sums<float>& sums) const {
        if (family == kWhite) white_.read(sums, same);
        if (family == kAr1) relaxation_.read(sums, same);
        if (family == kFractional) fractional_.read(sums, same);
        sums.ratio *= reference_;
        for (int k = 0; k < shapes(family) + parts(family) + 1; ++k) sums.weighted[k] *= reference_;
    }

    // The excess of -log L at the best scale.
    float nll(const Sums<float>& sums, float scale, bool) const {
        return sums.log_spectrum - ordinates * excess(scale / reference_ - 1.0f);
    }

  private:
    static float same(float x) { return x; }

    template <class Shape, int kNumbers>
    bool add(const Shape& shape, const Bins& bins, const Natural<float>& natural, int most,
             RunningSums<float, kNumbers>& sums) {
        const BinColumns<Bins> columns = {bins};
        const float unit = over_unit_ / reference_;
        for (int k = 0; k < most && at_ < bins.size(); ++k, ++at_) {
            add_bin<ExcessLikelihood>(shape, columns, static_cast<std::size_t>(at_), bins.power(at_) * unit,
                                      natural, sums);
        }
        return at_ == bins.size();
    }

    float over_unit_, reference_;
    int at_;
    RunningSums<float, 4> fractional_;
    RunningSums<float, 3> relaxation_;
    RunningSums<float, 1> white_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
