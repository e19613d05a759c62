// The core's clock from the Arduino core's.
#pragma once

#include <Arduino.h>
#include <clock.h>

namespace fltea {

class MicrosClock final : public Clock {
  public:
    uint32_t now_us() override { return micros(); }
};

}  // namespace fltea
