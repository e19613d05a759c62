// Limits some work to a proportion of the processor time. kPercent of the time that passes is added to an
// allowance. The time that the work takes is subtracted from it.
#pragma once

#include <stdint.h>

namespace fltea {

template <uint32_t kPercent>
class Allowance {
  public:
    // Starts with no allowance, so the work first has to wait.
    void begin(uint32_t now_us) {
        at_us_ = now_us;
        earned_ = 0;
    }

    // Adds to the allowance what the time until now_us has earned. Call this at least once in ten minutes.
    void pass(uint32_t now_us) {
        const uint32_t passed_us = now_us - at_us_;
        at_us_ = now_us;
        const uint32_t most_us = kMost / kPercent;
        earned_ += static_cast<int32_t>((passed_us < most_us ? passed_us : most_us) * kPercent);
        if (earned_ > kMost) earned_ = kMost;
    }

    bool left() const { return earned_ > 0; }

    // Subtracts the time that the work took from the allowance. If it took more than was left, the allowance
    // becomes negative.
    void spend(uint32_t took_us) { earned_ -= static_cast<int32_t>(100 * took_us); }

  private:
    // Largest allowance that can accumulate: the allowance that one second adds.
    static constexpr int32_t kMost = 1000000 * kPercent;

    uint32_t at_us_ = 0;
    int32_t earned_ = 0;  // allowance in hundredths of a microsecond
};

}  // namespace fltea
