// Tracks one axis with the noise model that the device's own fit has found: estimates the coloured part of
// its noise (the state), and the bias, which is the constant offset plus the mean of the state over the next
// samples.
#ifndef FLTEA_TRACKED_STATE_HPP
#define FLTEA_TRACKED_STATE_HPP

#include "axis_motion.hpp"
#include "offset_step.hpp"
#include "steady_filter.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// `samples`: length of the last motion, in which samples were only predicted and nothing was learned. `ago`:
// number of samples since that motion. Both are 0 if there was none lately.
struct Unlearned {
    std::uint32_t samples, ago;
};

// Tracks bias and state of one axis. All values are in counts.
class TrackedState {
  public:
    struct Figures {
        float bias, bias_std, state, state_std;
    };

    TrackedState() : filter_(), known_(false), there_(0), base_(0), offset_(0), offset_n_(0), learned_() {}

    // Whether set() has set a filter.
    bool known() const { return known_; }

    // Sets the Kalman filter that is used from the next sample on. Also sets the offset to the mean of all
    // samples at rest.
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

    // Processes a sample. `moving`: the sensor moves, so nothing is learned.
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
            // A large innovation is clipped, so that a knock on the sensor hardly changes the state and the
            // mean.
            if (e * e > kClip * kClip * filter_.S) {
                e = e < 0 ? -most() : most();
                apart = static_cast<std::int32_t>(offset_ + predicted + e);
            }
            for (int k = 0; k < there_; ++k) now().x[places_[k]] += filter_.gain[places_[k]] * e;
        }
        // This limit of the number of samples is reached only after months.
        if (now().n == kMost) {
            now().n /= 2;
            now().sum /= 2;
        }
        ++now().n;
        now().sum += apart;
    }

    // Predicts the state across `lost` samples that are missing.
    void skip(std::uint32_t lost) {
        for (int k = 0; k < there_; ++k) now().x[places_[k]] *= power(1.0f - filter_.fall[places_[k]], lost);
    }

    // Judges whether the newest chunk of innovations is noise or motion, and updates the offset at rest. Call
    // this after every AxisMotion::kChunk samples.
    AxisMotion::Verdict judge(const Unlearned& unlearned, bool moving) {
        float grown = 0;
        for (int k = 0; moving && k < there_; ++k) grown += grown_variance(places_[k], unlearned);
        const AxisMotion::Verdict found = motion_.judge(known_ ? filter_.S : 1.0f, grown, moving);
        if (moving || found.knock) {
            step_.clear();
        } else if (!known_) {
            // Without a filter, the offset becomes the mean of this chunk.
            offset_ += found.mean;
        } else if (there_ == 0) {
            // Nothing follows a step of the offset if the noise is white, so such a step has to be detected.
            // If the noise has a state, the state follows the step.
            float size = 0;
            const std::uint16_t chunks = step_.add(found.mean, math::sqrt(found.variance), size);
            if (chunks != 0) {
                begin_at(offset_ + size, chunks);
            } else if (now().n - offset_n_ > offset_n_ / 4) {
                // The offset is computed anew whenever the number of samples has grown by a quarter. Soon
                // after a step this happens often: the mean is over few samples then, and each chunk improves
                // it much.
                take_offset();
            }
        }
        return found;
    }

    // Stores what is known at present. What the call before stored is kept as well: undo() restores that.
    void keep() {
        learned_[kOlder] = learned_[kNewer];
        learned_[kNewer] = learned_[kNow];
    }
    // Restores what was stored by the call of keep() before the last one, and predicts the state across the
    // `samples` samples since that call.
    void undo(std::uint32_t samples) {
        learned_[kNow] = learned_[kOlder];
        if (known_) take_offset();
        skip(samples);
    }

    // Sets the bias to the mean of the newest chunk.
    void settle() {
        float offset = offset_ + motion_.mean();
        for (float& one : now().x) {
            offset += one;
            one = 0;
        }
        begin_at(offset, 1);
    }

    // Bias and state after the newest sample. Call this only if known().
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
        // The offset is a mean of n samples. If it is wrong, it shifts all innovations by the same amount,
        // whose variance is S / n (`offset`; S: variance of the innovations). A shift of 1 means an error of
        // `in_bias` in the bias, and of `in_state` in the state.
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
    // Innovations are clipped at this number of standard deviations.
    static constexpr float kClip = 6;

    // What was learned from all samples at rest: their number, the sum of their differences from base_, and
    // the present values of the state's parts.
    struct Learned {
        std::int64_t sum;
        std::uint32_t n;
        float x[kPlaces];
    };

    // indexes in learned_. kNow: what is known at present. kNewer: what the last call of keep() stored.
    // kOlder: what the call before that stored
    enum { kNow, kNewer, kOlder, kKept };

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

    // Returns the additional variance of part i of the state because of a motion. During the motion nothing
    // is learned, and the error of the part grows with each of `unlearned.samples`. Afterwards the filter
    // multiplies this error by a(1 - K) at each of `unlearned.ago` samples, with the part's pole a and gain
    // K.
    float grown_variance(int i, const Unlearned& unlearned) const {
        const float a = 1.0f - filter_.fall[i], left = a * (1.0f - filter_.gain[i]);
        return filter_.variance[i] * (1.0f - power(a * a, unlearned.samples)) *
               power(left * left, unlearned.ago);
    }

    // Begins the mean of samples anew: `offset` is the mean of the newest `chunks` chunks.
    void begin_at(float offset, std::uint16_t chunks) {
        offset_ = offset;
        offset_n_ = now().n = chunks * static_cast<std::uint32_t>(+AxisMotion::kChunk);
        // The sum is offset times offset_n_. The integer part and the rest of `offset` are multiplied
        // separately, so that each number fits into int32_t when it is converted from float.
        const std::int32_t whole = static_cast<std::int32_t>(offset);
        const float rest = offset - static_cast<float>(whole);
        now().sum = static_cast<std::int64_t>(whole) * offset_n_ +
                    static_cast<std::int32_t>(rest * static_cast<float>(offset_n_));
        learned_[kNewer] = learned_[kOlder] = now();
        step_.clear();
    }

    // Sets the offset to the mean of all samples at rest, and changes the state as if all these samples had
    // been filtered with that offset.
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

    // A new filter may give some parts of the state no gain. Distributes the values of these parts over the
    // others.
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
    unsigned char there_, places_[kPlaces];  // number and indexes of the state's parts that have a gain
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
