// The core's clock from the Arduino core's.
#pragma once

#include <Arduino.h>
#include <clock.h>

namespace fltea {

// micros() takes the milliseconds from SysTick's handler: while interrupts are masked for longer than one, it
// stands still and loses what passes. Nothing here masks them but identity.h, for microseconds, before the
// first sample.
class MicrosClock final : public Clock {
  public:
    uint32_t now_us() override { return micros(); }
};

}  // namespace fltea
