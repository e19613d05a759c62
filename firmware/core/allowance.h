// A share of the time that some work may take: what passes earns it, what it takes spends it.
#pragma once

#include <stdint.h>

namespace fltea {

template <uint32_t kPercent>
class Allowance {
  public:
    // Nothing has been earned.
    void begin(uint32_t now_us) {
        at_us_ = now_us;
        earned_ = 0;
    }

    // Time has come to now_us; at least once in ten minutes.
    void pass(uint32_t now_us) {
        const uint32_t passed_us = now_us - at_us_;
        at_us_ = now_us;
        const uint32_t most_us = kMost / kPercent;
        earned_ += static_cast<int32_t>((passed_us < most_us ? passed_us : most_us) * kPercent);
        if (earned_ > kMost) earned_ = kMost;
    }

    bool left() const { return earned_ > 0; }

    // The work took so long. It may take more than was left: the rest is owed.
    void spend(uint32_t took_us) { earned_ -= static_cast<int32_t>(100 * took_us); }

  private:
    // What a second earns: so much is kept for later.
    static constexpr int32_t kMost = 1000000 * kPercent;

    uint32_t at_us_ = 0;
    int32_t earned_ = 0;  // hundredths of a microsecond
};

}  // namespace fltea
