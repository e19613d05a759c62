// The interface through which the core uses an I2C controller.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

enum class I2cResult : uint8_t {
    ok,
    nack,        // the chip did not acknowledge its address or the data
    timeout,     // the transfer did not end within settings::kI2cTimeoutUs, because a line is held low
    short_read,  // fewer bytes were read than requested
};

// Which lines of the bus are low although this controller has released them, so that another chip must be
// holding them. The detail of the fault bus_held has the same values.
enum class HeldLines : uint8_t { none = 0, sda = 1, scl = 2, both = 3 };

class I2cBus {
  public:
    // Reads n bytes, beginning at register `reg`: writes address and register, sends a repeated start and
    // reads n bytes in one transaction, so that all bytes of a value belong together. Unless the result is
    // ok, the data is undefined.
    virtual I2cResult read(uint8_t address, uint8_t reg, uint8_t* data, size_t n) = 0;

    virtual I2cResult write(uint8_t address, uint8_t reg, uint8_t value) = 0;

    // Frees a bus that a sensor holds in the middle of a byte: up to nine clock pulses until SDA is high,
    // then a STOP (I2C specification NXP UM10204, 3.1.16). Then sets up the controller again.
    virtual HeldLines recover() = 0;

  protected:
    ~I2cBus() = default;
};

}  // namespace fltea
