// Waits without blocking. A wait ends correctly across every wrap of the 32-bit clock, if it is checked at
// least every 35 minutes.
#pragma once

#include <stdint.h>

namespace fltea {

constexpr uint32_t kSecondUs = 1000000;

// A wait of a given length.
class Pause {
  public:
    void begin(uint32_t now_us, uint32_t length_us) {
        begun_us_ = now_us;
        length_us_ = length_us;
        waiting_ = true;
    }

    // Whether the wait has ended. Also returns true before the first wait.
    bool over(uint32_t now_us) {
        if (waiting_ && now_us - begun_us_ >= length_us_) waiting_ = false;
        return !waiting_;
    }

    // Whether the wait was still in progress at the last call of over().
    bool waiting() const { return waiting_; }

  private:
    uint32_t begun_us_ = 0;
    uint32_t length_us_ = 0;
    bool waiting_ = false;
};

// A task that is due every second. The task stays due until it is done. Seconds that pass until then do not
// add further tasks.
class EverySecond {
  public:
    void begin(uint32_t first_us) { next_us_ = first_us; }

    bool due(uint32_t now_us) {
        const uint32_t late_us = now_us - next_us_;
        if (late_us < UINT32_C(0x80000000)) {
            next_us_ += (late_us / kSecondUs + 1) * kSecondUs;
            due_ = true;
        }
        return due_;
    }

    void done() { due_ = false; }

  private:
    uint32_t next_us_ = 0;
    bool due_ = false;
};

}  // namespace fltea
