// The interface through which the core reads the clock.
#pragma once

#include <stdint.h>

namespace fltea {

class Clock {
  public:
    // Returns the time since boot [us], which wraps every 2^32 us.
    virtual uint32_t now_us() = 0;

  protected:
    ~Clock() = default;
};

}  // namespace fltea
