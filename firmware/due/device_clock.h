// The device's time: channel 0 of the timer TC0 counts at MCK/2 = 42 MHz, and gives an interrupt once per
// sampling period.
#pragma once

#include "../core/clock.h"

namespace fltea {
namespace due {

class DeviceClock final : public Clock {
  public:
    // Starts the clock at 0. Call this once.
    void start();

    // The time in microseconds. It may be read anywhere, also in interrupt handlers, and is right even if the
    // handler of the tick was delayed by up to 100 s.
    uint32_t now_us() override;
};

}  // namespace due
}  // namespace fltea
