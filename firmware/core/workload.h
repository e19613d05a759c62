// Measures the proportion of time in which the main loop works, and the longest pass of the loop. Passes
// without work do not count. So boards that sleep between samples can be compared with boards that do not.
#pragma once

#include <stdint.h>

namespace fltea {

class Workload {
  public:
    // Begins a new measurement of the workload.
    void begin(uint32_t now_us) {
        begun_us_ = now_us;
        worked_us_ = 0;
        longest_us_ = 0;
    }

    // Adds a pass of the main loop that did some work.
    void add(uint32_t took_us) {
        worked_us_ += took_us;
        if (took_us > longest_us_) longest_us_ = took_us;
    }

    // Returns the proportion of the time since begin() in which the main loop worked [0.01 %]. This is
    // correct for less than 71 minutes after begin().
    uint16_t share(uint32_t now_us) const {
        const uint32_t hundredths_of_per_cent = (now_us - begun_us_) / 10000;
        const uint32_t share = hundredths_of_per_cent == 0 ? 0 : worked_us_ / hundredths_of_per_cent;
        return static_cast<uint16_t>(share < 10000 ? share : 10000);
    }

    uint32_t longest_us() const { return longest_us_; }

  private:
    uint32_t begun_us_ = 0;
    uint32_t worked_us_ = 0;
    uint32_t longest_us_ = 0;
};

}  // namespace fltea
