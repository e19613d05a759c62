// What the core asks of the line to the host.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

class ByteSink {
  public:
    // Bytes that write() takes now without waiting.
    virtual size_t room() = 0;

    // Takes n ≤ room() bytes; never waits.
    virtual void write(const uint8_t* data, size_t n) = 0;

  protected:
    ~ByteSink() = default;
};

}  // namespace fltea
