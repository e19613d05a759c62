// What the core asks of an I2C controller.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

enum class I2cResult : uint8_t {
    ok,
    nack,        // nobody acknowledged: address or data
    timeout,     // not finished within settings::kI2cTimeoutUs: a line is held
    short_read,  // fewer bytes than asked for
};

// Lines that are low although nobody here pulls them; the values are those of FaultCode::bus_held's detail.
enum class HeldLines : uint8_t { none = 0, sda = 1, scl = 2, both = 3 };

class I2cBus {
  public:
    // n bytes from register `reg` on: address and register written, repeated start, n bytes read in one
    // transaction, so that no value is torn. On any other result than ok the data is meaningless.
    virtual I2cResult read(uint8_t address, uint8_t reg, uint8_t* data, size_t n) = 0;

    virtual I2cResult write(uint8_t address, uint8_t reg, uint8_t value) = 0;

    // Frees a bus that a sensor holds in mid-byte: up to nine clocks until SDA is high, then a STOP
    // (NXP UM10204, 3.1.16), then the controller set up again.
    virtual HeldLines recover() = 0;

  protected:
    ~I2cBus() = default;
};

}  // namespace fltea
