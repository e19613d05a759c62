// Decides from the innovations of an axis's filter, in chunks of 32 samples, whether the axis is at rest. The
// rules are those by which the live fit leaves samples out (firmware/core/engine/gate.hpp), but chunks are
// shorter, and the size of the noise is known from the filter.
//
// A chunk that shows motion is called a knock. A chunk can be a knock for any of three reasons:
//     - The power of its innovations, without the largest one, exceeds sixteen times that of the noise.
//     - One innovation exceeds a hundred standard deviations.
//     - The mean of its innovations exceeds eight standard deviations of such a mean.
// But the chunk is no knock if its samples scatter no more than usual about their mean, and if this mean
// differs from the bias by no more than a possible step of the bias.
//
// Spectral lines and other effects that are not motion remain in the filter's innovations, and samples of
// coloured noise scatter widely about their mean. Each chunk is therefore compared with what is usual for
// chunks at rest.
#pragma once

#include <cmath>

namespace fltea {
namespace track {

// Usual power of a chunk's innovations, and usual square of their mean. Both are ratios to the values that
// follow from the filter's noise model, and are never less than 1.
struct Usual {
    double power = 1, mean = 1;
};

// The gate's verdict on a chunk of one axis.
struct ChunkVerdict {
    bool knock;
    // whether the samples of the chunk scatter no more than usual about their mean, and this mean is near
    // that of the previous chunk
    bool same_place;
    double place;  // mean of the chunk's samples, or NaN if it has fewer than two samples
};

class RestGate {
  public:
    enum { kChunk = 32 };
    static constexpr double kKnock = 16, kSpike = 100, kMean = 8;

    const Usual& usual() const { return usual_; }
    void expect(const Usual& usual) { usual_ = usual; }

    // Adds a sample `y`. `z`: its innovation divided by the innovation's standard deviation. `deviation`:
    // standard deviation of the noise of one sample. Returns true if this sample alone shows motion.
    bool add(double z, double y, double deviation) {
        z = bounded(z);
        const double power = z * z;
        sum_ += z;
        powers_ += power;
        if (power > largest_) largest_ = power;
        if (known_ == 0) first_ = y;
        const double apart = bounded((y - first_) / deviation);
        if (known_ == 0 || apart < low_) low_ = apart;
        if (known_ == 0 || apart > high_) high_ = apart;
        own_ += apart;
        own_powers_ += apart * apart;
        ++known_;
        return power > kSpike * kSpike * usual_.power;
    }

    // Forgets the samples of the present chunk. Call this when the bias has changed.
    void forget_chunk() {
        known_ = 0;
        sum_ = powers_ = largest_ = own_ = own_powers_ = 0;
    }

    // Ends a chunk without judging it.
    void drop_chunk() {
        forget_chunk();
        has_place_ = false;
    }

    // Ends a chunk and judges it. `bias`: the bias so far. `largest_step`: largest possible step of the bias.
    ChunkVerdict end_chunk(double deviation, double bias, double largest_step, bool moving) {
        const int n = known_;
        ChunkVerdict found = {false, false, __builtin_nan("")};
        if (n > 1) {
            const double mean = own_ / n, own_power = std::fmax(own_powers_ - mean * own_, 0) / (n - 1);
            const double most = kKnock * usual_.power, apart = kMean * std::sqrt(usual_.mean);
            const double most_apart = std::fmax(high_ - mean, mean - low_),
                         spike = kSpike * kSpike * usual_.power;
            const bool still =
                most_apart * most_apart < spike && own_power < kKnock * std::fmax(usual_own_, usual_.power);
            found.place = first_ + mean * deviation;
            const double step = has_place_ ? (found.place - place_) / deviation : 0;
            found.same_place = still && has_place_ && std::fabs(step) < kMean * std::sqrt(usual_step_);
            found.knock = powers_ - largest_ > most * (n - 1) || largest_ > spike ||
                          std::fabs(sum_) > apart * std::sqrt(double(n));
            // During motion, a small scatter is not enough: the mean has to be about that of the previous
            // chunk. Otherwise, rest would begin while the samples are still changing.
            const bool lies = moving ? found.same_place : still;
            if (lies && !(std::fabs(found.place - bias) > largest_step)) found.knock = false;
            if (!moving && !found.knock) {
                usual_own_ = learned(usual_own_, own_power, 1);
                if (has_place_) usual_step_ = learned(usual_step_, step * step, 2.0 / kChunk);
            }
            place_ = found.place;
            has_place_ = still;
        } else {
            has_place_ = false;
        }
        forget_chunk();
        return found;
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(known_, 0, kChunk);
        io.number(has_place_, 0, 1);
        io.real(sum_, -1e300, 1e300);
        io.real(powers_, 0, 1e300);
        io.real(largest_, 0, 1e300);
        for (double* one : {&own_, &low_, &high_}) io.real(*one, -1e300, 1e300);
        io.real(own_powers_, 0, 1e300);
        io.real(first_, -1e150, 1e150);
        io.real(place_, -1e300, 1e300);
        io.real(usual_.power, 1, 1e300);
        io.real(usual_.mean, 1, 1e300);
        io.real(usual_own_, 1, 1e300);
        io.real(usual_step_, 2.0 / kChunk, 1e300);
    }

  private:
    static constexpr double kLearned = 1 / 16.0, kOutlier = 4;

    // Clips x, so that its square is finite.
    static double bounded(double x) { return x > 1e100 ? 1e100 : x < -1e100 ? -1e100 : x; }

    static double learned(double before, double now, double least) {
        const double used = std::fmin(now, kOutlier * before);
        return std::fmax(before + kLearned * (used - before), least);
    }

    Usual usual_;
    int known_ = 0;
    bool has_place_ = false;
    double sum_ = 0, powers_ = 0, largest_ = 0, first_ = 0, place_ = 0;
    // From each sample of the present chunk, the chunk's first sample is subtracted. The result is divided by
    // the standard deviation of the noise. These are the sum of the results, their sum of squares, the
    // smallest and the largest.
    double own_ = 0, own_powers_ = 0, low_ = 0, high_ = 0;
    double usual_own_ = 1, usual_step_ = 2.0 / kChunk;
};

}  // namespace track
}  // namespace fltea
