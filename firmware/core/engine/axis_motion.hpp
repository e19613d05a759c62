// Decides whether the newest chunk of an axis's innovations is noise or motion of the sensor. The rules are
// those of the host's tracker (host/native/rest_gate.hpp), in float, and without a division per sample.
//
// A chunk of 32 is a knock in any of three cases: the power of its innovations, without the largest one, is
// sixteen times that of the noise; one innovation exceeds a hundred deviations; or the mean exceeds eight of
// its deviations. Spectral lines and other effects that the filter does not follow make the innovations
// larger than the filter predicts. They are therefore compared with their usual power and mean at rest, where
// these are larger.
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
        bool knock;      // the chunk is not noise about the prediction
        float mean;      // mean of its innovations
        float variance;  // variance of that mean at rest
        // number of consecutive chunks that were knocks and still, at the level of the previous chunk
        std::uint16_t stood;
    };

    // Without a filter: the usual power is learned from the first chunks, in squared counts.
    AxisMotion() { begin(kOfRounding, 0); }
    // With a filter: its S is the least variance of the innovations.
    void begin_with_filter() { begin(1, kLearned); }

    // Adds an innovation, without clipping.
    void add(float e) {
        const float power = e * e;
        sum_ += e;
        powers_ += power;
        if (power > largest_) largest_ = power;
    }

    // Mean of the newest chunk.
    float mean() const { return last_mean_; }

    // Judges kChunk samples. `S`: variance of the innovations, or 1 without a filter. `grown`: how much the
    // variance of the predictions exceeds its normal value during this chunk, because samples were left out.
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
    // Squared deviations by which a prediction may be wrong.
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

    float least_, usual_power_, usual_mean_;  // as ratios to S
    float sum_, powers_, largest_, last_mean_;
    std::uint16_t chunks_, stood_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
