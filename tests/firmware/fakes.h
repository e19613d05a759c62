// Simple models of the hardware: a clock that stands still unless it is advanced, a sensor as a register
// file, a bus and a UART with faults on demand. In every test, these models check that the firmware keeps all
// rules on which the real hardware relies.
#pragma once

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <functional>
#include <vector>

#include "byte_sink.h"
#include "clock.h"
#include "i2c_bus.h"
#include "receiver.h"
#include "settings.h"

class FakeClock final : public fltea::Clock {
  public:
    explicit FakeClock(uint64_t start_us = 0) : start_us_(start_us), us_(start_us) {}

    uint32_t now_us() override { return static_cast<uint32_t>(us_); }

    void pass(uint64_t us) { us_ += us; }
    uint64_t us() const { return us_; }                  // the time as a number that does not wrap
    uint64_t run_us() const { return us_ - start_us_; }  // time since the test began

  private:
    uint64_t start_us_;
    uint64_t us_;
};

// The rate that a FakeChip returns for gyro_x when its registers are not as required.
constexpr int16_t kWrong = 0x5A5A;

// An MPU-9250 as the driver sees it. Its register numbers are typed by hand from the register map. A burst
// (one read of all measured values) differs from the burst before, unless `frozen` is set. In a burst,
// accel_x counts resets and losses of supply (`life`). gyro_x is kWrong if a register was not as required.
class FakeChip {
  public:
    uint8_t who_am_i = 0x71;
    uint8_t wanted[5] = {0x00, 0x01, 0x18, 0x00, 0x01};  // required values of the registers 0x19 to 0x1D
    bool frozen = false;
    // the sensor has stopped: a burst repeats the last values until the next reset
    bool stopped = false;
    bool reserved_ones = false;  // bits without a meaning read as 1
    int16_t gyro_y = 7;
    std::vector<uint8_t> stuck;  // numbers of registers that ignore writes
    int16_t life = 0;
    bool quiet = false;  // the chip never pulses its data-ready pin

    explicit FakeChip(FakeClock& clock) : clock_(clock) { power_up(); }

    // Resets the registers, as a loss of supply does. The driver does not notice.
    void power_up() {
        std::memset(registers_, 0, sizeof registers_);
        registers_[0x6B] = who_am_i == 0x68 ? 0x40 : 0x01;
        stopped = false;
        ++life;
    }

    void write(uint8_t reg, uint8_t value) {
        ready();
        if (reg == 0x6B && (value & 0x80) != 0) {
            power_up();
            reset_us_ = clock_.us();
            resetting_ = true;
            return;
        }
        if (who_am_i == 0x68 && reg == 0x1D) FAIL("the MPU-6050 has no such register");
        for (uint8_t dead : stuck) {
            if (dead == reg) return;
        }
        if (reg == 0x6B) woken_us_ = clock_.us();
        registers_[reg & 0x7F] = value;
    }

    void read(uint8_t reg, uint8_t* data, size_t n) {
        ready();
        if (reg == 0x3B) {
            REQUIRE(n == 14);
            convert();
        }
        if (who_am_i == 0x68) REQUIRE(!(reg <= 0x1D && reg + n > 0x1D));
        registers_[0x75] = who_am_i;
        std::memcpy(data, registers_ + reg, n);
        if (!reserved_ones) return;
        for (size_t i = 0; i < n; ++i) data[i] |= reserved(static_cast<uint8_t>(reg + i));
    }

    uint8_t reg(uint8_t number) const { return registers_[number]; }

    bool as_wanted() const {
        const size_t n = who_am_i == 0x68 ? 4 : 5;
        return std::memcmp(registers_ + 0x19, wanted, n) == 0 && registers_[0x6B] == 0x01;
    }

    bool pulses() const { return !quiet && as_wanted() && registers_[0x38] == 0x01; }

  private:
    static uint8_t reserved(uint8_t reg) {
        switch (reg) {
            case 0x1A:
                return 0x80;
            case 0x1B:
                return 0x04;
            case 0x1C:
                return 0x07;
            case 0x1D:
                return 0xF0;
            case 0x37:
                return 0x01;
            case 0x38:
                return 0xA6;
            case 0x6B:
                return 0x80;  // the bit H_RESET, which clears itself
            default:
                return 0;
        }
    }

    // Checks that the first transfer after a reset comes at least 100 ms after it.
    void ready() {
        if (resetting_) REQUIRE(clock_.us() - reset_us_ >= 100000);
        resetting_ = false;
    }

    void convert() {
        REQUIRE(clock_.us() - woken_us_ >= 35000);  // start-up time of the gyroscope after sleep
        if (!frozen && !stopped) ++conversions_;
        const int16_t gyro_x = as_wanted() ? static_cast<int16_t>(conversions_ % 1000) : kWrong;
        const int16_t values[] = {life, -1, 16384, -256, gyro_x, gyro_y, -30000};
        for (size_t i = 0; i < 7; ++i) {
            const uint16_t bits = static_cast<uint16_t>(values[i]);
            registers_[0x3B + 2 * i] = static_cast<uint8_t>(bits >> 8);
            registers_[0x3B + 2 * i + 1] = static_cast<uint8_t>(bits & 0xFF);
        }
    }

    FakeClock& clock_;
    uint8_t registers_[128 + 16];
    uint32_t conversions_ = 0;
    uint64_t reset_us_ = 0;
    uint64_t woken_us_ = 0;
    bool resetting_ = false;
};

// Longest time that recover() of an I2cBus takes [us], while it sends nine clock pulses and a STOP.
constexpr uint64_t kRecoverUs = 900;

class FakeBus final : public fltea::I2cBus {
  public:
    bool plugged = true;
    // results of the next transfers; the transfers after these have the result ok
    std::deque<fltea::I2cResult> script;
    fltea::HeldLines held = fltea::HeldLines::none;
    // the controller has kept a byte, which shifts the bytes of each read until recover() is called
    bool stale = false;
    int wrong_reads = 0;  // number of reads that were wrong by a flipped bit or a shift
    int flips = 0;        // number of future reads from flip_reg on in which one bit is wrong
    uint8_t flip_reg = 0;
    uint8_t flip_mask = 0x01;
    // this function is called with the register and the data of each read
    std::function<void(uint8_t, uint8_t*)> tamper;
    // number of recoveries after which the bus line in `held` is free again; -1: never
    int clocks_to_free = 0;
    int recoveries = 0;
    int failures = 0;
    std::vector<uint8_t> written;     // numbers of the registers that were written, in order
    void (*during)(void*) = nullptr;  // this function is called in the middle of every transfer
    void* during_of = nullptr;

    FakeBus(FakeClock& clock, FakeChip& chip) : clock_(clock), chip_(chip) {}

    void fail(fltea::I2cResult result, size_t times) { script.insert(script.end(), times, result); }

    fltea::I2cResult read(uint8_t address, uint8_t reg, uint8_t* data, size_t n) override {
        const fltea::I2cResult result = transfer(address, n + 3);
        std::memset(data, 0xEE, n);
        if (result != fltea::I2cResult::ok) return result;
        chip_.read(reg, data, n);
        if (stale) {
            std::rotate(data, data + n - 1, data + n);
            std::swap(data[0], held_byte_);
            ++wrong_reads;
        }
        if (flips > 0 && reg == flip_reg) {
            --flips;
            ++wrong_reads;
            data[0] ^= flip_mask;
        }
        if (tamper) tamper(reg, data);
        return result;
    }

    fltea::I2cResult write(uint8_t address, uint8_t reg, uint8_t value) override {
        const fltea::I2cResult result = transfer(address, 3);
        if (result == fltea::I2cResult::ok) {
            written.push_back(reg);
            chip_.write(reg, value);
        }
        return result;
    }

    fltea::HeldLines recover() override {
        ++recoveries;
        stale = false;
        clock_.pass(kRecoverUs);
        if (held != fltea::HeldLines::none && clocks_to_free > 0 && --clocks_to_free == 0) {
            held = fltea::HeldLines::none;
        }
        return held;
    }

  private:
    fltea::I2cResult transfer(uint8_t address, size_t bytes) {
        CHECK(address == fltea::settings::kSensorAddress);
        fltea::I2cResult result = fltea::I2cResult::ok;
        if (!script.empty()) {
            result = script.front();
            script.pop_front();
        }
        if (!plugged) result = fltea::I2cResult::nack;
        if (held != fltea::HeldLines::none) result = fltea::I2cResult::timeout;
        if (result != fltea::I2cResult::ok) ++failures;
        // A byte takes nine clock periods of 2.5 us. Half of the transfer's time passes before `during` is
        // called.
        const uint64_t us =
            result == fltea::I2cResult::timeout ? fltea::settings::kI2cTimeoutUs : bytes * 45 / 2;
        clock_.pass(us / 2);
        if (during != nullptr) during(during_of);
        clock_.pass(us - us / 2);
        return result;
    }

    FakeClock& clock_;
    FakeChip& chip_;
    uint8_t held_byte_ = 0xEE;
};

// A ring buffer from which the UART sends 25 bytes a millisecond.
class FakeSink final : public fltea::ByteSink {
  public:
    size_t size = 127;    // bytes that the ring buffer holds, as many as the Arduino core's
    bool jammed = false;  // the UART sends nothing
    Receiver receiver;
    std::vector<uint8_t> bytes;

    explicit FakeSink(FakeClock& clock) : clock_(clock) {}

    size_t room() override {
        drain();
        return size - std::min(size, static_cast<size_t>(waiting_));
    }

    void write(const uint8_t* data, size_t n) override {
        const size_t room_now = room();
        REQUIRE(n <= room_now);
        const size_t frames = receiver.frames.size();
        receiver.feed(data, n);
        bytes.insert(bytes.end(), data, data + n);
        waiting_ += static_cast<double>(n);
        // Each write must be exactly one complete frame, and has to leave room for a sample. Only messages
        // with the device's estimates may use that room, as long as no sample is due.
        REQUIRE(receiver.frames.size() == frames + 1);
        REQUIRE(data[n - 1] == 0);
        const uint8_t type = receiver.frames.back().type;
        const bool at_quiet = type >= fltea::Estimate::type() && type <= fltea::Spectrum::type();
        if (type != fltea::Sample::type() && !at_quiet) REQUIRE(room_now - n >= 28);
    }

    // Returns all frames of one message type.
    template <typename Message>
    std::vector<Frame> of() const {
        std::vector<Frame> found;
        for (const Frame& frame : receiver.frames) {
            if (frame.type == Message::type()) found.push_back(frame);
        }
        return found;
    }

  private:
    void drain() {
        const uint64_t us = clock_.us() - drained_us_;
        drained_us_ = clock_.us();
        if (!jammed) waiting_ = std::max(0.0, waiting_ - static_cast<double>(us) * 0.025);
    }

    FakeClock& clock_;
    uint64_t drained_us_ = 0;
    double waiting_ = 0;
};
