// What the device tracks of one axis by the noise that its own fit has found: the coloured part of a sample,
// its state, and the bias, which is the offset and the mean of the state over the samples to come.
#ifndef FLTEA_TRACKED_STATE_HPP
#define FLTEA_TRACKED_STATE_HPP

#include "axis_motion.hpp"
#include "offset_step.hpp"
#include "steady_filter.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// So many samples that were predicted only, and the samples since.
struct Unlearned {
    std::uint32_t samples, ago;
};

// In counts.
class TrackedState {
  public:
    struct Figures {
        float bias, bias_std, state, state_std;
    };

    TrackedState() : filter_(), known_(false), there_(0), base_(0), offset_(0), offset_n_(0), learned_() {}

    // A filter is there.
    bool known() const { return known_; }

    // From the next sample on the noise is this. The offset is the mean of all samples, and is known again.
    void set(const SteadyFilter& filter) {
        filter_ = filter;
        there_ = 0;
        for (int i = 0; i < kPlaces; ++i) {
            if (filter_.gain[i] != 0) places_[there_++] = static_cast<unsigned char>(i);
        }
        for (Learned& one : learned_) hand_over(one);
        if (!known_) motion_.begin_with_filter();
        take_offset();
        known_ = true;
    }

    // A sample. moving: the sensor is, so that nothing is learned.
    void next(std::int16_t count, bool moving = false) {
        if (now().n == 0) base_ = count;
        std::int32_t apart = count - base_;
        float predicted = 0;
        for (int k = 0; k < there_; ++k) {
            const int i = places_[k];
            now().x[i] -= filter_.fall[i] * now().x[i];
            predicted += now().x[i];
        }
        float e = (static_cast<float>(apart) - offset_) - predicted;
        motion_.add(e);
        if (moving) return;
        if (known_) {
            // A knock moves neither the state nor the mean.
            if (e * e > kClip * kClip * filter_.S) {
                e = e < 0 ? -most() : most();
                apart = static_cast<std::int32_t>(offset_ + predicted + e);
            }
            for (int k = 0; k < there_; ++k) now().x[places_[k]] += filter_.gain[places_[k]] * e;
        }
        // In months.
        if (now().n == kMost) {
            now().n /= 2;
            now().sum /= 2;
        }
        ++now().n;
        now().sum += apart;
    }

    // So many samples are lost.
    void skip(std::uint32_t lost) {
        for (int k = 0; k < there_; ++k) now().x[places_[k]] *= power(1.0f - filter_.fall[places_[k]], lost);
    }

    // After each AxisMotion::kChunk samples.
    AxisMotion::Verdict judge(const Unlearned& unlearned, bool moving) {
        float grown = 0;
        for (int k = 0; moving && k < there_; ++k) grown += grown_variance(places_[k], unlearned);
        const AxisMotion::Verdict found = motion_.judge(known_ ? filter_.S : 1.0f, grown, moving);
        if (moving || found.knock) {
            step_.clear();
        } else if (!known_) {
            // Without a filter it is where the chunk before was.
            offset_ += found.mean;
        } else if (there_ == 0) {
            // A state would follow a step.
            float size = 0;
            const std::uint16_t chunks = step_.add(found.mean, math::sqrt(found.variance), size);
            if (chunks != 0) {
                begin_at(offset_ + size, chunks);
            } else if (now().n - offset_n_ > offset_n_ / 4) {
                // Soon after a step the mean is known better with each chunk.
                take_offset();
            }
        }
        return found;
    }

    // What is known now can be gone back to, as long as keep() has been called once more at most.
    void keep() {
        learned_[kOlder] = learned_[kNewer];
        learned_[kNewer] = learned_[kNow];
    }
    // What was learned in so many samples, since the last keep() but one, is forgotten: they are predicted.
    void undo(std::uint32_t samples) {
        learned_[kNow] = learned_[kOlder];
        if (known_) take_offset();
        skip(samples);
    }

    // The bias is where the samples of the newest chunk were.
    void settle() {
        float offset = offset_ + motion_.mean();
        for (float& one : now().x) {
            offset += one;
            one = 0;
        }
        begin_at(offset, 1);
    }

    // After the newest sample. Once a filter is known.
    Figures figures(const Unlearned& unlearned) const {
        float state = 0, bias = 0, variance = 0, grown = 0, bias_grown = 0;
        for (int i = 0; i < kPlaces; ++i) {
            const float weight = filter_.weight[i];
            state += now().x[i];
            bias += weight * now().x[i];
            variance += filter_.variance[i];
            if (unlearned.samples == 0 || filter_.variance[i] == 0) continue;
            const float more = grown_variance(i, unlearned);
            grown += more;
            bias_grown += weight * weight * more;
        }
        // An error of the offset, of which the mean of n samples has S / (n answer²), is found in the state.
        const float offset = filter_.S / static_cast<float>(offset_n_ == 0 ? 1 : offset_n_);
        const float in_bias = filter_.offset_in_bias,
                    in_state = 1.0f / filter_.answer - filter_.R / filter_.S;
        const float of_bias = filter_.of_bias + bias_grown + in_bias * in_bias * offset;
        const float of_state = filter_.of_state + grown + in_state * in_state * offset;
        const Figures result = {static_cast<float>(base_) + offset_ + bias, math::sqrt(of_bias), state,
                                math::sqrt(math::fmin(of_state, variance))};
        return result;
    }

  private:
    enum { kPlaces = SteadyFilter::kPlaces };
    static constexpr std::uint32_t kMost = 0x7FFFFFFF;
    // An innovation of more deviations counts as one of so many.
    static constexpr float kClip = 6;

    // Of all samples at rest: their number, their sum less base_, and the parts of the state.
    struct Learned {
        std::int64_t sum;
        std::uint32_t n;
        float x[kPlaces];
    };

    enum { kNow, kNewer, kOlder, kKept };  // what is known, and what was when keep() was called

    Learned& now() { return learned_[kNow]; }
    const Learned& now() const { return learned_[kNow]; }

    static float power(float base, std::uint32_t n) {
        float result = 1;
        for (; n != 0; n >>= 1) {
            if ((n & 1) != 0) result *= base;
            base *= base;
        }
        return result;
    }

    float most() const { return kClip * math::sqrt(filter_.S); }

    // What noise has added to a part while nothing was learned, as far as it is left: the filter forgets by
    // a(1 - K) or so a sample.
    float grown_variance(int i, const Unlearned& unlearned) const {
        const float a = 1.0f - filter_.fall[i], left = a * (1.0f - filter_.gain[i]);
        return filter_.variance[i] * (1.0f - power(a * a, unlearned.samples)) *
               power(left * left, unlearned.ago);
    }

    // The offset is the mean of the newest chunks, so many.
    void begin_at(float offset, std::uint16_t chunks) {
        offset_ = offset;
        offset_n_ = now().n = chunks * static_cast<std::uint32_t>(+AxisMotion::kChunk);
        // In two parts, each of which an int32_t holds.
        const std::int32_t whole = static_cast<std::int32_t>(offset);
        const float rest = offset - static_cast<float>(whole);
        now().sum = static_cast<std::int64_t>(whole) * offset_n_ +
                    static_cast<std::int32_t>(rest * static_cast<float>(offset_n_));
        learned_[kNewer] = learned_[kOlder] = now();
        step_.clear();
    }

    // The offset is the mean of all samples; the state as if all had been filtered with it.
    void take_offset() {
        const float before = offset_;
        offset_ = now().n == 0 ? 0.0f : static_cast<float>(now().sum) / static_cast<float>(now().n);
        offset_n_ = now().n;
        if (!known_) return;
        const float apart = (offset_ - before) * filter_.answer;
        for (int k = 0; k < there_; ++k) {
            const int i = places_[k];
            const float shift = apart * filter_.gain[i] / filter_.fall[i];
            for (Learned& one : learned_) one.x[i] -= shift;
        }
    }

    // What the filter before knew of parts that are there no more, its others have.
    void hand_over(Learned& learned) const {
        float left = 0, variance = 0;
        for (int i = 0; i < kPlaces; ++i) {
            if (filter_.gain[i] != 0) {
                variance += filter_.variance[i];
            } else {
                left += learned.x[i];
                learned.x[i] = 0;
            }
        }
        for (int k = 0; k < there_; ++k) {
            const int i = places_[k];
            learned.x[i] += left * (filter_.variance[i] / variance);
        }
    }

    SteadyFilter filter_;
    bool known_;
    unsigned char there_, places_[kPlaces];  // what has a gain: so many
    std::int32_t base_;
    float offset_;
    std::uint32_t offset_n_;
    Learned learned_[kKept];
    AxisMotion motion_;
    OffsetStep step_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
