// The device's time: channel 0 of TC0 counts MCK/2 = 42 MHz freely, and interrupts once a sampling period.
#pragma once

#include "../core/clock.h"

namespace fltea {
namespace due {

class DeviceClock final : public Clock {
  public:
    // From 0, and from now on. Once.
    void start();

    // May be called anywhere, in interrupt handlers too: it is right even if the tick's handler has been kept
    // waiting, for up to 100 s.
    uint32_t now_us() override;
};

}  // namespace due
}  // namespace fltea
