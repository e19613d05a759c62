// Makes the clock of the Arduino libraries available through the interface Clock of fltea's own core.
#pragma once

#include <Arduino.h>
#include <clock.h>

namespace fltea {

// micros() uses the milliseconds that the interrupt handler of SysTick counts. If interrupts are masked for
// longer than a millisecond, micros() stops and loses time. In this sketch only identity.h masks interrupts,
// for microseconds and before the first sample.
class MicrosClock final : public Clock {
  public:
    uint32_t now_us() override { return micros(); }
};

}  // namespace fltea
