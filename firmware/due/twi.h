// The sensor's I2C bus: TWI1 as master at 400 kHz on PB12 (SDA, pin 20) and PB13 (SCL, pin 21). The program
// polls it and uses no interrupts.
#pragma once

#include "../core/clock.h"
#include "../core/i2c_bus.h"

namespace fltea {
namespace due {

class Twi final : public I2cBus {
  public:
    // `clock` must be running. Call recover() before the first transfer, because it sets up the pins and the
    // controller.
    explicit Twi(Clock& clock) : clock_(clock) {}

    // Reads n bytes. n has to be at least 1.
    I2cResult read(uint8_t address, uint8_t reg, uint8_t* data, size_t n) override;
    I2cResult write(uint8_t address, uint8_t reg, uint8_t value) override;
    HeldLines recover() override;

  private:
    I2cResult receive(uint8_t* data, size_t n);
    I2cResult wait_for(uint32_t flag);
    I2cResult finish(I2cResult result);
    void pause();

    Clock& clock_;
    uint32_t begun_us_ = 0;
};

}  // namespace due
}  // namespace fltea
