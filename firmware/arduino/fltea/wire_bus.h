// The sensor's I2C bus, which is driven by Arduino's library Wire. This class makes up for four weaknesses of
// that library. Wire never frees a bus whose lines a chip holds low. Wire's time-outs last tens of
// milliseconds. Wire does not distinguish a time-out from a NACK. If a byte is left in the I2C controller,
// Wire takes that byte for the first byte of the next read.
#pragma once

#include <Arduino.h>
#include <Wire.h>
#include <i2c_bus.h>
#include <settings.h>

namespace fltea {

class WireBus final : public I2cBus {
  public:
    explicit WireBus(TwoWire& wire) : wire_(wire) {}

    I2cResult read(uint8_t address, uint8_t reg, uint8_t* data, size_t n) override {
        if (!idle()) return I2cResult::timeout;
        const uint32_t began_us = micros();
        // Even after a complete read, the controller may still hold an old byte (firmware/due/twi.cpp). Wire
        // would take the old byte for the first byte of the new read, so it is fetched and dropped here.
        const uint32_t stale = WIRE_INTERFACE->TWI_RHR;
        static_cast<void>(stale);
        // A repeated start has to follow the register number. Only the overload of requestFrom() with an
        // internal address sends a repeated start.
        const size_t got = wire_.requestFrom(address, static_cast<uint8_t>(n), static_cast<uint32_t>(reg),
                                             static_cast<uint8_t>(1), static_cast<uint8_t>(true));
        for (size_t i = 0; i < got && i < n; ++i) data[i] = static_cast<uint8_t>(wire_.read());
        if (got == n) return I2cResult::ok;
        const bool late = too_long(began_us);
        start();
        if (late) return I2cResult::timeout;
        return got == 0 ? I2cResult::nack : I2cResult::short_read;
    }

    I2cResult write(uint8_t address, uint8_t reg, uint8_t value) override {
        if (!idle()) return I2cResult::timeout;
        const uint32_t began_us = micros();
        wire_.beginTransmission(address);
        wire_.write(reg);
        wire_.write(value);
        if (wire_.endTransmission() == 0) return I2cResult::ok;
        const bool late = too_long(began_us);
        start();
        return late ? I2cResult::timeout : I2cResult::nack;
    }

    // Frees a bus whose lines are held low. This takes about 0.15 ms.
    HeldLines recover() override {
        release(PIN_WIRE_SDA);
        release(PIN_WIRE_SCL);
        for (int clock = 0; clock < kRecoveryClocks && low(PIN_WIRE_SDA); ++clock) {
            pull(PIN_WIRE_SCL);
            release(PIN_WIRE_SCL);
        }
        // The sequence ends with a STOP condition: SDA rises while SCL is high.
        pull(PIN_WIRE_SCL);
        pull(PIN_WIRE_SDA);
        release(PIN_WIRE_SCL);
        release(PIN_WIRE_SDA);
        const unsigned held = (low(PIN_WIRE_SDA) ? 1u : 0u) | (low(PIN_WIRE_SCL) ? 2u : 0u);
        // start() gives the pins to Wire without pinMode(). But pinMode() remembers the mode that it last set
        // for a pin, and does nothing if that mode is requested again. If that were the mode of release(),
        // the next release() would not take the pins back from Wire. So another mode is set here.
        pinMode(PIN_WIRE_SDA, INPUT);
        pinMode(PIN_WIRE_SCL, INPUT);
        start();
        return static_cast<HeldLines>(held);
    }

  private:
    static constexpr int kRecoveryClocks = 9;
    static constexpr uint32_t kHalfClockUs = 5;

    // Resets the I2C controller. Otherwise a byte that the sensor did not acknowledge would stay in the
    // controller and be sent with the next write.
    void start() {
        wire_.begin();
        wire_.setClock(settings::kI2cHz);
    }

    static bool low(uint32_t pin) { return digitalRead(pin) == LOW; }

    // release() and pull() drive a line as open drain: the line is pulled low or released, but never driven
    // high.
    static void release(uint32_t pin) {
        pinMode(pin, INPUT_PULLUP);
        delayMicroseconds(kHalfClockUs);
    }
    static void pull(uint32_t pin) {
        digitalWrite(pin, LOW);
        pinMode(pin, OUTPUT);
        delayMicroseconds(kHalfClockUs);
    }

    // Whether both lines of the bus are high. This is checked before each transfer: on a bus that is held
    // low, Wire would wait for its long time-out.
    static bool idle() {
        if (!low(PIN_WIRE_SDA) && !low(PIN_WIRE_SCL)) return true;
        delayMicroseconds(kHalfClockUs);
        return !low(PIN_WIRE_SDA) && !low(PIN_WIRE_SCL);
    }

    static bool too_long(uint32_t began_us) { return micros() - began_us > settings::kI2cTimeoutUs; }

    TwoWire& wire_;
};

}  // namespace fltea
