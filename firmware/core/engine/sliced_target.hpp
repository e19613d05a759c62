// The sums over the bins of a spectrum that a fit on the device needs. They are computed in float and a few
// bins at a time.
//
// What is stored is not -log L, but its excess over the -log L of a spectrum that equals the data. This
// excess is Σ c (r - 1 - log r). Here r = I/S is the power of a bin divided by the model's power, and c is
// the number of ordinates in the bin. The excess is about as large as the number of bins. -log L itself is
// about as large as the number of ordinates, and float would lose the significant digits.
#ifndef FLTEA_SLICED_TARGET_HPP
#define FLTEA_SLICED_TARGET_HPP

#include <cstddef>

#include "real_math.hpp"
#include "whittle_shapes.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// Returns u - log(1 + u) for u > -1, without loss of precision for small u. With s = u / (2 + u), the
// logarithm is the series 2 s + 2/3 s³ + ...
inline float excess(float u) {
    if (u > 0.4f || u < -0.28f) return u - math::log(1.0f + u);
    const float s = u / (2.0f + u), z = s * s;
    const float sum = 0.6666666667f + z * (0.4f + z * (0.2857142857f + z * 0.2222222222f));
    return s * (u - z * sum);
}

// The values of each bin (fit_bins.hpp) that the spectra in whittle_shapes.hpp need.
template <class Bins>
struct BinColumns {
    const Bins& bins;
    float counts(std::size_t i) const { return bins.counts(static_cast<int>(i)); }
    float ln_size(std::size_t i) const { return bins.ln_size(static_cast<int>(i)); }
    float turn(std::size_t i) const { return bins.lam(static_cast<int>(i)); }
    float quarter(std::size_t i) const { return 0.5f * (3.14159265f - turn(i)); }
    float square(std::size_t i) const { return math::exp(2.0f * ln_size(i)); }
};

// Computes the sums over the bins for a spectrum, which is the model's spectrum times the factor reference().
// The powers of the bins are divided by their mean, unit(). -log L is stored as its excess (see the top of
// this file).
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

    // Call this before the evaluations of another model.
    void begin_model() {
        for (float& one : mean_) one = 0;
    }
    // Begins an evaluation of the likelihood. Then call add() until it returns true. `together`: number of
    // neighbouring bins that are combined into one at the frequency of the middle one. This is approximate,
    // but faster by the factor `together`.
    void begin_sums(int together = 1) {
        at_ = 0;
        together_ = together;
        sums_ = PartSums();
    }
    bool add(const Bins& bins, Family family, const Natural<float>& natural, int most) {
        switch (family) {
            case kWhite:
                return add_white(bins, most);
            case kAr1:
                return add(Relaxations<float, 1>(natural), bins, natural, most);
            default:
                return add(Fractional<float>(natural), bins, natural, most);
        }
    }
    // Writes the sums of a finished evaluation. They contain derivatives of the model's log spectrum by each
    // of its numbers, such as the logarithm of a variance. From each derivative, its mean over the bins in
    // the previous evaluation is subtracted, because float keeps more digits of small values. This does not
    // change the fit: a constant that is added to a derivative only changes the scale of the spectrum, which
    // is free.
    //
    // The derivatives by the logarithms of the two variances (of the state, and of the white noise) add up to
    // 1. Each has its own sums nevertheless. If one was computed as 1 minus the other, float would lose its
    // digits where it is small.
    void read(Family family, Sums<float>& sums) {
        const int numbers = shapes(family) + parts(family) + 1;
        sums.log_spectrum = sums_.excess;
        sums.ratio = sums_.ratio * reference_;
        if (numbers == 1) {
            sums.slope[0] = sums.square[0][0] = ordinates;
            sums.weighted[0] = sums.ratio;
            return;
        }
        int square = 0;
        for (int k = 0; k < numbers; ++k) {
            sums.slope[k] = sums_.slope[k];
            mean_[k] += sums_.slope[k] / ordinates;
            sums.weighted[k] = sums_.weighted[k] * reference_;
            for (int j = 0; j <= k; ++j) sums.square[k][j] = sums_.square[square++];
        }
    }

    // Returns the excess of -log L over the -log L of a spectrum that equals the data, at the scale that fits
    // best.
    float nll(const Sums<float>& sums, float scale, bool) const {
        return sums.log_spectrum - ordinates * excess(scale / reference_ - 1.0f);
    }

  private:
    enum { kMostNumbers = 4 };
    // The unfinished sums while bins are being added, in the same order as in Sums.
    struct PartSums {
        float excess, ratio, slope[kMostNumbers], weighted[kMostNumbers];
        float square[kMostNumbers * (kMostNumbers + 1) / 2];
    };

    bool add_white(const Bins& bins, int most) {
        const float unit = over_unit_ / reference_;
        for (int k = 0; k < most && at_ < bins.size(); ++k, ++at_) {
            const float ratio = bins.power(at_) * unit, count = bins.counts(at_);
            sums_.ratio += count * ratio;
            sums_.excess += count * excess_of(ratio);
        }
        return at_ == bins.size();
    }

    template <class Shape>
    bool add(const Shape& shape, const Bins& bins, const Natural<float>& natural, int most) {
        enum { kPart = Shape::kShapes, kWhiteNoise = kPart + 1, kNumbers = kPart + 2 };
        const BinColumns<Bins> columns = {bins};
        const float unit = over_unit_ / reference_;
        for (int n = 0; n < most && at_ < bins.size(); ++n) {
            const int end = bins.size() - at_ < together_ ? bins.size() : at_ + together_;
            const int middle = at_ + (end - at_) / 2;
            float part = 0, by[kPart], D[kNumbers], count = bins.counts(at_), power = bins.power(at_);
            if (end > at_ + 1) {
                power *= count;
                for (int i = at_ + 1; i < end; ++i) {
                    count += bins.counts(i);
                    power += bins.counts(i) * bins.power(i);
                }
                power /= count;
            }
            at_ = end;
            shape.at(columns, static_cast<std::size_t>(middle), &part, by);
            part *= natural.variance[0];
            const float inverse = 1.0f / (part + natural.white);
            const float ratio = power * unit * inverse, over = count * ratio;
            sums_.excess += count * excess_of(ratio);
            sums_.ratio += over;
            D[kPart] = part * inverse;
            D[kWhiteNoise] = natural.white * inverse;
            for (int k = 0; k < kPart; ++k) D[k] = by[k] * D[kPart];
            for (int k = 0; k < kNumbers; ++k) D[k] -= mean_[k];
            int square = 0;
            for (int k = 0; k < kNumbers; ++k) {
                const float counted = count * D[k];
                sums_.slope[k] += counted;
                sums_.weighted[k] += over * D[k];
                for (int j = 0; j <= k; ++j, ++square) sums_.square[square] += counted * D[j];
            }
        }
        return at_ == bins.size();
    }

    // Returns what one ordinate adds to the excess (see the top of this file). `ratio`: the ordinate's power
    // divided by the model's. A ratio below 1e-7 is replaced by 1e-7, because 0 has no logarithm.
    static float excess_of(float ratio) { return excess((ratio > 1e-7f ? ratio : 1e-7f) - 1.0f); }

    float over_unit_, reference_;
    int at_, together_;
    // for each derivative of the log spectrum: its mean over the bins in the previous evaluation
    float mean_[kMostNumbers];
    PartSums sums_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
