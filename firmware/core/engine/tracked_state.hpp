// What the device tracks of one axis by the noise that its own fit has found: the coloured part of a sample,
// its state, and the bias, which is the state and the offset.
#ifndef FLTEA_TRACKED_STATE_HPP
#define FLTEA_TRACKED_STATE_HPP

#include "steady_filter.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// In counts.
class TrackedState {
  public:
    struct Figures {
        float bias, bias_std, state, state_std;
    };

    TrackedState() : filter_(), known_(false), there_(0), n_(0), base_(0), sum_(0), offset_(0), offset_n_(0) {
        for (float& one : x_) one = 0;
    }

    // A filter is there.
    bool known() const { return known_; }

    // From the next sample on the noise is this. The offset is the mean of all samples, and is known again.
    void set(const SteadyFilter& filter) {
        const float before = offset_;
        offset_ = n_ == 0 ? 0.0f : static_cast<float>(sum_) / static_cast<float>(n_);
        offset_n_ = n_;
        filter_ = filter;
        hand_over();
        if (known_) {
            // As if all had been filtered with this offset.
            const float apart = (offset_ - before) * filter.answer;
            for (int k = 0; k < there_; ++k) {
                const int i = places_[k];
                x_[i] -= apart * filter.gain[i] / filter.fall[i];
            }
        }
        known_ = true;
    }

    void next(std::int16_t count) {
        if (n_ == 0) base_ = count;
        std::int32_t apart = count - base_;
        if (known_) {
            float predicted = 0;
            for (int k = 0; k < there_; ++k) {
                const int i = places_[k];
                x_[i] -= filter_.fall[i] * x_[i];
                predicted += x_[i];
            }
            float e = (static_cast<float>(apart) - offset_) - predicted;
            // A knock moves neither the state nor the mean.
            if (e * e > kClip * kClip * filter_.S) {
                e = e < 0 ? -most() : most();
                apart = static_cast<std::int32_t>(offset_ + predicted + e);
            }
            for (int k = 0; k < there_; ++k) x_[places_[k]] += filter_.gain[places_[k]] * e;
        }
        // In months.
        if (n_ == kMost) {
            n_ /= 2;
            sum_ /= 2;
        }
        ++n_;
        sum_ += apart;
    }

    // So many samples are lost.
    void skip(std::uint32_t lost) {
        for (int k = 0; k < there_; ++k) {
            float factor = 1.0f - filter_.fall[places_[k]];
            for (std::uint32_t rest = lost; rest != 0; rest >>= 1) {
                if ((rest & 1) != 0) x_[places_[k]] *= factor;
                factor *= factor;
            }
        }
    }

    // After the newest sample. Once a filter is known.
    Figures figures() const {
        float state = 0, variance = 0;
        for (int i = 0; i < kPlaces; ++i) {
            state += x_[i];
            variance += filter_.variance[i];
        }
        const float n = static_cast<float>(offset_n_ == 0 ? 1 : offset_n_);
        // An error of the offset, of which the mean of n samples has S / (n answer²), is found in the state.
        const float of_bias = filter_.of_state + filter_.R * filter_.R / (filter_.S * n);
        const float of_offset = 1.0f / filter_.answer - filter_.R / filter_.S;
        const float of_state = filter_.of_state + of_offset * of_offset * filter_.S / n;
        const Figures result = {static_cast<float>(base_) + offset_ + state, math::sqrt(of_bias), state,
                                math::sqrt(math::fmin(of_state, variance))};
        return result;
    }

  private:
    enum { kPlaces = SteadyFilter::kPlaces };
    static constexpr std::uint32_t kMost = 0x7FFFFFFF;
    // An innovation of more deviations counts as one of so many.
    static constexpr float kClip = 6;

    float most() const { return kClip * math::sqrt(filter_.S); }

    // What the filter before knew of parts that are there no more, its others have.
    void hand_over() {
        float left = 0, variance = 0;
        there_ = 0;
        for (int i = 0; i < kPlaces; ++i) {
            if (filter_.gain[i] != 0) {
                places_[there_++] = static_cast<unsigned char>(i);
                variance += filter_.variance[i];
            } else {
                left += x_[i];
                x_[i] = 0;
            }
        }
        for (int k = 0; k < there_; ++k) {
            const int i = places_[k];
            x_[i] += left * (filter_.variance[i] / variance);
        }
    }

    SteadyFilter filter_;
    bool known_;
    int there_;
    unsigned char places_[kPlaces];  // what has a gain: so many
    std::uint32_t n_;
    std::int32_t base_;
    std::int64_t sum_;
    float offset_;
    std::uint32_t offset_n_;
    float x_[kPlaces];
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
