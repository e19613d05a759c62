// The serial port to the host: the UART's transmitter, which the PDC (the chip's DMA controller) feeds from a
// ring buffer in RAM.
#pragma once

#include "../core/byte_sink.h"

namespace fltea {
namespace due {

class Uart final : public ByteSink {
  public:
    // Sets up the serial port on PA9 (the programming port) with 250,000 baud, 8N1. It only sends, and never
    // receives. Call this once.
    void start();

    size_t room() override;
    void write(const uint8_t* data, size_t n) override;
};

}  // namespace due
}  // namespace fltea
