// The clock of the Arduino core behind the interface of fltea's core.
#pragma once

#include <Arduino.h>
#include <clock.h>

namespace fltea {

// micros() uses the milliseconds that the interrupt handler of SysTick counts. If interrupts are masked for
// longer than a millisecond, micros() stops and loses time. Only identity.h masks interrupts here, for
// microseconds, before the first sample.
class MicrosClock final : public Clock {
  public:
    uint32_t now_us() override { return micros(); }
};

}  // namespace fltea
