// The device's time: channel 0 of TC0 counts MCK/2 = 42 MHz, and interrupts once per sampling period.
#pragma once

#include "../core/clock.h"

namespace fltea {
namespace due {

class DeviceClock final : public Clock {
  public:
    // Starts the clock at 0. Call this once.
    void start();

    // May be called anywhere, also in interrupt handlers. The time is right even if the tick's handler was
    // delayed, by up to 100 s.
    uint32_t now_us() override;
};

}  // namespace due
}  // namespace fltea
