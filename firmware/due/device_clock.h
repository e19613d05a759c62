// The device's time. Channel 0 of the timer TC0 counts at MCK/2 = 42 MHz, and causes an interrupt (a tick)
// once per sampling period.
#pragma once

#include "../core/clock.h"

namespace fltea {
namespace due {

class DeviceClock final : public Clock {
  public:
    // Starts the clock at 0. Call this once.
    void start();

    // Returns the time in microseconds. This may be called anywhere, also in interrupt handlers. The time is
    // right even if the handler of the timer's interrupt was delayed by up to 100 s.
    uint32_t now_us() override;
};

}  // namespace due
}  // namespace fltea
