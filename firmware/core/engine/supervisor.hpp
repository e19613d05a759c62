// The supervisor of one lane (one axis) watches the estimates of that lane's filter. It declares them invalid
// if the filter has diverged or the samples do not fit the filter's R, the variance of white noise. The
// filter computes the same numbers with and without a supervisor. The supervisor applies these rules after
// each sample:
//
// - runaway: an estimate is not finite, or an order is beyond ±kLostOrder. The lane is invalid at this
//   sample, and restarts at the next one with initial values and an empty memory. This only happens if the
//   filter has no guard.
// - bound: the guard had to limit the state in more than kBoundMost of the last kBoundSamples samples. Then R
//   does not fit the samples: the sensor moves, an offset remains, or R is wrong. The lane is invalid until
//   the number of limited samples has fallen to half of kBoundMost, and then restarts.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The estimates of a diverged filter can stay finite for ever, with orders of 10 to 60 and f up to 1e139. The
// order of noise is between 0 and 2, and no useful estimate was seen beyond 3.5.
constexpr int kLostOrder = 5;

constexpr int kBoundSamples = 200;
constexpr int kBoundMost = kBoundSamples / 4;

// Why the estimates of a lane (axis) have just become invalid.
enum class Loss : uint8_t { none = 0, runaway = 1, bound = 2 };

// finite() is not a template, because clang-tidy would report a - a in a template as a mistake.
inline bool finite(float a) { return a - a == 0; }
inline bool finite(double a) { return a - a == 0; }

// Judges after each sample whether the filter of one lane (axis) still works: whether its estimate may be
// published, and whether it has to restart. T is float or double.
template <class T>
class Supervisor {
  public:
    struct Verdict {
        bool valid;    // the estimate of this sample may be published
        bool restart;  // the lane and its supervisor have to restart at the next sample
        Loss news;
    };

    // Call this after each sample. `held`: whether the guard (guard.hpp) limited the state at this sample.
    Verdict judge(T alpha, T f, T state, bool held) {
        if (!(alpha <= kLostOrder && alpha >= -kLostOrder) || !finite(f) || !finite(state)) {
            return Verdict{false, true, Loss::runaway};
        }
        uint8_t& eight = held_[at_ / 8];
        const uint8_t bit = static_cast<uint8_t>(1u << at_ % 8);
        if (eight & bit) --count_;
        eight = static_cast<uint8_t>(held ? eight | bit : eight & ~bit);
        if (held) ++count_;
        at_ = static_cast<uint8_t>(at_ + 1 == kBoundSamples ? 0 : at_ + 1);
        if (!distrusted_ && count_ <= kBoundMost) return Verdict{true, false, Loss::none};
        const Loss news = distrusted_ ? Loss::none : Loss::bound;
        distrusted_ = count_ > kBoundMost / 2;
        return Verdict{false, !distrusted_, news};
    }

    // Whether the guard (guard.hpp) has not limited the state at any of the last kBoundSamples samples. Then
    // judge() need not be called for a further sample with a valid estimate: it would only move on to the
    // next place in its record.
    bool calm() const { return count_ == 0; }

    // Whether the state of a restored supervisor is one that judge() can produce.
    bool plausible() const {
        int held = 0;
        for (uint8_t eight : held_) {
            for (; eight != 0; eight = static_cast<uint8_t>(eight & (eight - 1))) ++held;
        }
        return at_ < kBoundSamples && count_ == held && distrusted_ <= 1 &&
               (distrusted_ ? count_ > kBoundMost / 2 : count_ <= kBoundMost);
    }

  private:
    static_assert(kBoundSamples % 8 == 0 && kBoundSamples <= 255, "places and counts are bytes");

    uint8_t held_[kBoundSamples / 8] = {};
    uint8_t at_ = 0;
    uint8_t count_ = 0;
    uint8_t distrusted_ = 0;  // 1 while the rule "bound" declares the lane invalid
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
