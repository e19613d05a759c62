// Declares an axis lost or not to be trusted. The same rules as on the host
// (host/fltea/estimator/supervisor.py): an order beyond 5 or a number that is not finite ends it at once; if
// the guard had to hold the state in more than a quarter of the last 200 samples, R does not fit the data,
// and the axis begins anew once it is less than half of that again.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

class Supervisor {
  public:
    struct Verdict {
        bool valid;
        bool restart;  // with the next sample
    };

    // After each sample. held: the guard held the state in it.
    Verdict judge(float alpha, float f, float state, bool held) {
        if (!(alpha <= kLostOrder && alpha >= -kLostOrder) || f - f != 0 || state - state != 0) {
            return Verdict{false, true};
        }
        uint8_t& eight = held_[at_ / 8];
        const uint8_t bit = static_cast<uint8_t>(1u << at_ % 8);
        if (eight & bit) --count_;
        eight = static_cast<uint8_t>(held ? eight | bit : eight & ~bit);
        if (held) ++count_;
        at_ = static_cast<uint8_t>(at_ + 1 == kSamples ? 0 : at_ + 1);
        if (!distrusted_ && count_ <= kMost) return Verdict{true, false};
        distrusted_ = count_ > kMost / 2;
        return Verdict{false, !distrusted_};
    }

  private:
    static constexpr float kLostOrder = 5.0f;
    static constexpr uint8_t kSamples = 200, kMost = kSamples / 4;

    uint8_t held_[kSamples / 8] = {};
    uint8_t at_ = 0;
    uint8_t count_ = 0;
    bool distrusted_ = false;
};

}  // namespace fltea
