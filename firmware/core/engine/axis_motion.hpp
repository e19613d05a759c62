// Whether the newest chunk of an axis's innovations is noise, or motion of the sensor. The rules are those of
// the host's tracker (host/native/rest_gate.hpp), in float and without a division a sample.
//
// A chunk of 32 is a knock if the power of its innovations, the largest not counted, is sixteen times that of
// the noise, if one of them alone is a hundred deviations away, or if their mean is eight of its deviations
// away. A line, or what else the filter does not follow, makes innovations larger than the filter says: they
// are compared with their usual power and mean at rest, where these are larger.
#ifndef FLTEA_AXIS_MOTION_HPP
#define FLTEA_AXIS_MOTION_HPP

#include <cstdint>

#include "real_math.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

class AxisMotion {
  public:
    enum { kChunk = 32 };
    static constexpr float kKnock = 16, kSpike = 100, kMean = 8;

    struct Verdict {
        bool knock;           // the chunk is not noise about what was predicted
        float mean;           // of its innovations
        float variance;       // of that mean at rest
        std::uint16_t stood;  // chunks in a row that were knocks, and still, at the place of the one before
    };

    // Without a filter: what is usual is learned from the first chunks, in squared counts.
    AxisMotion() { begin(kOfRounding, 0); }
    // With a filter, whose S is what innovations have at least.
    void begin_with_filter() { begin(1, kLearned); }

    // An innovation, not limited.
    void add(float e) {
        const float power = e * e;
        sum_ += e;
        powers_ += power;
        if (power > largest_) largest_ = power;
    }

    // Of the newest chunk.
    float mean() const { return last_mean_; }

    // After kChunk samples. S: variance of the innovations, or 1 without a filter. grown: how much more that
    // of what was predicted is, all chunk long, than if nothing had been left out.
    Verdict judge(float S, float grown, bool moving) {
        const float n = static_cast<float>(+kChunk), square = sum_ * sum_ / n;
        const float variance = S * math::fmax(usual_mean_, least_), apart = kGrown * n * grown;
        const float level = S * math::fmax(usual_power_, least_), power = kKnock * (n - 1) * level;
        const float most = kMean * kMean * variance;
        const bool knock =
            chunks_ >= kLearned && (powers_ - largest_ > power + apart || square > most + apart ||
                                    largest_ > kSpike * kSpike * level);
        const bool still = powers_ - square < power;
        const float mean = sum_ / n, moved = mean - last_mean_;
        const bool same = knock && still && moved * moved * n < 2 * most;
        stood_ = static_cast<std::uint16_t>(same ? stood_ + (stood_ < 0xFFFF ? 1 : 0) : 0);
        last_mean_ = mean;
        if (!moving && !knock) learn(powers_ / (n * S), square / S);
        clear();
        const Verdict verdict = {knock, mean, variance / n, stood_};
        return verdict;
    }

  private:
    // Deviations, squared, that a prediction may be away by.
    static constexpr float kGrown = 9;
    enum { kLearned = 8, kRemembered = 64 };
    static constexpr float kOfRounding = 1.0f / 12;

    void begin(float least, std::uint16_t chunks) {
        least_ = usual_power_ = usual_mean_ = least;
        chunks_ = chunks;
        stood_ = 0;
        last_mean_ = 0;
        clear();
    }

    void clear() { sum_ = powers_ = largest_ = 0; }

    void learn(float power, float mean) {
        if (chunks_ < kRemembered) ++chunks_;
        const float n = static_cast<float>(chunks_);
        usual_power_ += (power - usual_power_) / n;
        usual_mean_ += (mean - usual_mean_) / n;
    }

    float least_, usual_power_, usual_mean_;  // over S
    float sum_, powers_, largest_, last_mean_;
    std::uint16_t chunks_, stood_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
