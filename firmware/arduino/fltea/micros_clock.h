// Adapts the Arduino core's clock.
#pragma once

#include <Arduino.h>
#include <clock.h>

namespace fltea {

// micros() takes the milliseconds from SysTick's handler. While interrupts are masked for longer than a
// millisecond, it stops and loses time. Only identity.h masks interrupts here, for microseconds, before the
// first sample.
class MicrosClock final : public Clock {
  public:
    uint32_t now_us() override { return micros(); }
};

}  // namespace fltea
