// The interface through which the core writes to the serial port.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

class ByteSink {
  public:
    // Number of bytes that write() accepts now without waiting.
    virtual size_t room() = 0;

    // Sends n bytes without waiting. n must be at most room().
    virtual void write(const uint8_t* data, size_t n) = 0;

  protected:
    ~ByteSink() = default;
};

}  // namespace fltea
