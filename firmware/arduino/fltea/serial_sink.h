// The serial port to the host. Bytes go to the UART of the programming port through the ring buffer of the
// Arduino libraries, which has 128 bytes.
#pragma once

#include <Arduino.h>
#include <byte_sink.h>

namespace fltea {

class SerialSink final : public ByteSink {
  public:
    explicit SerialSink(UARTClass& serial) : serial_(serial) {}

    size_t room() override { return static_cast<size_t>(serial_.availableForWrite()); }

    void write(const uint8_t* data, size_t n) override { serial_.write(data, n); }

  private:
    UARTClass& serial_;
};

}  // namespace fltea
