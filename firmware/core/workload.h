// How much of the time the main loop works, and how long one turn of it takes. Turns that find nothing to do
// do not count, so that a port that never sleeps says the same as one that does.
#pragma once

#include <stdint.h>

namespace fltea {

class Workload {
  public:
    // A new stretch of time.
    void begin(uint32_t now_us) {
        begun_us_ = now_us;
        worked_us_ = 0;
        longest_us_ = 0;
    }

    // A turn that did something.
    void add(uint32_t took_us) {
        worked_us_ += took_us;
        if (took_us > longest_us_) longest_us_ = took_us;
    }

    // Since begin(), in hundredths of a per cent; for stretches of less than 71 minutes.
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
