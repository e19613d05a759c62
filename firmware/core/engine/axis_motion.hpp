// Decides whether the newest chunk of an axis's innovations shows only noise, or motion of the sensor. The
// rules are those of the host's tracker (host/native/rest_gate.hpp). Here they are computed in float, and
// without a division per sample.
//
// An innovation is a sample minus its prediction. A chunk of 32 innovations is a knock in any of three cases:
// their power, without the largest one, exceeds sixteen times that of the noise; one innovation exceeds a
// hundred standard deviations; or their mean exceeds eight standard deviations of such a mean. Spectral lines
// and other effects that the filter does not follow make the innovations larger than the filter predicts. If
// the usual power and mean at rest are larger than predicted, the innovations are therefore compared with
// these usual values.
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
        bool knock;      // whether the chunk shows more than noise around the predictions
        float mean;      // mean of the chunk's innovations
        float variance;  // variance of this mean at rest
        // number of consecutive chunks, ending with this one, that were knocks with a steady mean: the
        // innovations scattered little about their mean, and this mean was near that of the chunk before.
        // This is how the chunks look after a step of the bias
        std::uint16_t stood;
    };

    // Begins without a filter. Samples then take the place of innovations, and their usual power, in squared
    // counts, is learned from the first chunks.
    AxisMotion() { begin(kOfRounding, 0); }
    // Begins to judge the innovations of a filter, whose variance the filter predicts as S. Their usual power
    // is then learned anew, but judge() assumes at least S.
    void begin_with_filter() { begin(1, kLearned); }

    // Adds an innovation. It must not have been clipped before.
    void add(float e) {
        const float power = e * e;
        sum_ += e;
        powers_ += power;
        if (power > largest_) largest_ = power;
    }

    // Mean of the innovations of the newest chunk.
    float mean() const { return last_mean_; }

    // Judges the chunk of the last kChunk innovations. `S`: variance of the innovations as the filter
    // predicts it, or 1 without a filter. `grown`: additional variance of the predictions, because the filter
    // did not learn from the samples of a motion before this chunk.
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
    // A chunk is a knock only if the error of the predictions cannot explain it. That error is assumed to be
    // at most three standard deviations. This is the square of three.
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

    // All three are in units of the variance S that the filter predicts for an innovation. usual_power_:
    // usual mean of a chunk's squared innovations. usual_mean_: usual square of their mean, times their
    // number. least_: lower limit of both
    float least_, usual_power_, usual_mean_;
    float sum_, powers_, largest_, last_mean_;
    std::uint16_t chunks_, stood_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
