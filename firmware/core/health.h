// Operates the sensor: sets it up, reads it and recovers it. A failed transfer is tried once more. If a chip
// may be holding the I2C bus, nine clock pulses free the bus. The sensor is set up again after a few lost
// sampling instants, after a register had a wrong value, or when its values stop changing. A sensor that does
// not run is set up at most once a second. No call takes longer than 10 ms, which is the time for two failing
// transfers, three recoveries of the bus and the working transfers of a set-up.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "clock.h"
#include "faults.h"
#include "i2c_bus.h"
#include "messages.h"
#include "mpu9250.h"
#include "timers.h"

namespace fltea {

// Returns the number that HELLO reports as sensor_starts after `starts` set-ups of the sensor. 65535 is
// followed by 1, because 0 means that the sensor was not set up yet.
constexpr uint16_t start_number(uint32_t starts) {
    return static_cast<uint16_t>(starts == 0 ? 0 : (starts - 1) % 65535 + 1);
}

class Health {
  public:
    struct Reading {
        Sample sample;      // Health sets the sample's flags retried, saturated and repeated
        uint32_t burst_us;  // time just before the burst began
    };

    Health(I2cBus& bus, Clock& clock, Faults& faults, SamplingMode mode)
        : bus_(bus), clock_(clock), faults_(faults), sensor_(bus, mode) {}

    // Checks the wait before the next attempt to start the sensor. If it were not checked, it would not end
    // correctly after a wrap of the 32-bit clock. Call this in every step of the main loop.
    void pass_time(uint32_t now_us) { between_.over(now_us); }

    bool running() const { return state_ == State::running; }

    // Returns the number of transfers on the bus so far, including failed ones. This number wraps.
    uint32_t transfers() const { return transfers_; }

    // Continues the set-up. Call this in every step while the sensor does not run. Returns true when the
    // set-up is complete.
    bool set_up(uint32_t now_us) {
        retried_ = false;
        if (state_ == State::idle) {
            if (between_.over(now_us)) identify(now_us);
        } else if (pause_.over(now_us)) {
            if (state_ == State::resetting) {
                configure();
            } else {
                start();
            }
        }
        return running();
    }

    // Reads the sensor at one sampling instant. Returns false if there is no sample. If running() is then
    // false, too, the sensor has to be set up again with set_up().
    bool read(Reading& reading) {
        uint8_t burst[Mpu9250::kBurstBytes];
        retried_ = false;
        const bool done = transfer([&]() -> I2cResult {
            reading.burst_us = clock_.now_us();
            return sensor_.read_burst(burst);
        });
        // The settings are checked after the burst, to detect a chip that was reset before the burst.
        if (!done || !guarded()) {
            if (running() && ++lost_instants_ == kLostInstants) stop(FaultCode::sensor_lost, errors_in_row_);
            return false;
        }
        lost_instants_ = 0;
        errors_in_row_ = 0;
        count_equal(burst);
        if (equal_ == kMostEqual) {
            doubt(FaultCode::sensor_frozen, equal_);
            return false;
        }
        decode_burst(burst, reading.sample);
        reading.sample.flags = flags(reading.sample);
        return true;
    }

    // Stops the sensor, so that it is set up again. Call this when the sensor answers but its data-ready pin
    // gives no edges.
    void data_ready_missing(uint32_t silence_us) { stop(FaultCode::data_ready_missing, silence_us); }

    // Values that HELLO and STATUS report.
    uint8_t who_am_i() const { return who_am_i_; }
    uint16_t sensor_starts() const { return start_number(starts_); }
    uint32_t sensor_reinits() const { return starts_ == 0 ? 0 : starts_ - 1; }
    uint32_t i2c_errors() const { return i2c_errors_; }
    uint32_t bus_recoveries() const { return bus_recoveries_; }

  private:
    enum class State : uint8_t { idle, resetting, settling, running };

    // Result of reading back a setting of the chip.
    enum class Answer : uint8_t { right, right_at_second, wrong, none };

    // After this many consecutive sampling instants without a sample, the chip is set up again. These are at
    // least three instants, and at least 30 ms. A disturbance is shorter than that, and the host waits
    // longer.
    static constexpr uint8_t kLostInstants =
        settings::kSamplePeriodUs < 10000 ? 30000 / settings::kSamplePeriodUs : 3;
    // Number of equal bursts after which the chip is set up again. With noise in seven channels, consecutive
    // bursts of a working chip are never equal. Those of a sleeping chip are equal, and its settings do not
    // show that it sleeps.
    static constexpr uint8_t kMostEqual = 10;
    // After a reset the registers answer as after power-up: within 100 ms (data sheet PS-MPU-9250A-01,
    // start-up time).
    static constexpr uint32_t kResetUs = 100000;
    // The gyroscope needs 35 ms after sleep (data sheet PS-MPU-9250A-01, 3.1); an MPU-6050 sleeps after its
    // reset.
    static constexpr uint32_t kSettleUs = 50000;

    // Interval at which a missing sensor is probed. If a sensor answers but its set-up fails, the next set-up
    // comes after a second instead, because it is not urgent.
    static constexpr uint32_t kProbeUs = 100000;

    // Tries a transfer. Repeats it if it fails and no other transfer was repeated in this step.
    template <typename Transfer>
    bool transfer(Transfer go) {
        for (;;) {
            ++transfers_;
            const I2cResult result = go();
            if (result == I2cResult::ok) return true;
            count_error();
            const bool again = !retried_;
            retried_ = true;
            // After a NACK the transfer is first repeated without freeing the bus: a NACK comes over a bus
            // that works.
            if (result != I2cResult::nack || !again) {
                if (!recover(result)) return false;
            }
            if (!again) return false;
        }
    }

    // Frees the I²C bus. Returns false if one of its lines is still held low.
    bool recover(I2cResult result) {
        held_ = bus_.recover();
        if (held_ != HeldLines::none) {
            faults_.raise(FaultCode::bus_held, static_cast<uint32_t>(held_));
            return false;
        }
        if (result != I2cResult::nack) ++bus_recoveries_;
        return true;
    }

    // Reads a setting twice if the first answer is wrong. I2C has no checksum, so a wrong answer may be a
    // flipped bit.
    template <typename Read, typename Right>
    Answer ask(Read read, Right right) {
        if (!transfer(read)) return Answer::none;
        if (right()) return Answer::right;
        if (!transfer(read)) return Answer::none;
        if (!right()) return Answer::wrong;
        count_error();
        return Answer::right_at_second;
    }

    void count_error() {
        ++i2c_errors_;
        ++errors_in_row_;
    }

    // Whether the burst that was just read can be trusted, because the chip still has its settings.
    bool guarded() {
        uint8_t guard[Mpu9250::kGuardBytes];
        size_t wrong = 0;
        const Answer answer = ask([&]() -> I2cResult { return sensor_.read_guard(guard); },
                                  [&]() -> bool {
                                      wrong = sensor_.first_mismatch(guard);
                                      return wrong == Mpu9250::kSettings;
                                  });
        if (answer == Answer::wrong) mismatch(wrong, guard[wrong - Mpu9250::kGuardStart]);
        return answer == Answer::right;
    }

    void identify(uint32_t now_us) {
        between_.begin(now_us, kProbeUs);
        if (doubtful_) bus_.recover();
        doubtful_ = false;
        uint8_t answer = 0;
        if (!transfer([&]() -> I2cResult { return sensor_.read_who_am_i(answer); })) {
            if (held_ != HeldLines::none) return;
            // The first probe without an answer is no fault yet. At power-up the board is ready before the
            // sensor, which is ready 11 to 100 ms after power-up (data sheet PS-MPU-9250A-01, 3.4.2).
            if (unanswered_) faults_.raise(FaultCode::sensor_missing, settings::kSensorAddress);
            unanswered_ = true;
            return;
        }
        unanswered_ = false;
        who_am_i_ = answer;
        const SensorKind* const kind = find_sensor_kind(answer);
        if (kind == nullptr) {
            doubt(FaultCode::sensor_unknown, answer);
            return;
        }
        sensor_.set_kind(*kind);
        between_.begin(now_us, kSecondUs);
        if (!transfer([&]() -> I2cResult { return sensor_.start_reset(); })) {
            stop(FaultCode::sensor_lost, errors_in_row_);
            return;
        }
        wait(State::resetting, kResetUs);
    }

    void configure() {
        for (size_t i = 0; i < Mpu9250::kSettings; ++i) {
            if (!sensor_.has_setting(i)) continue;
            uint8_t kept = 0;
            Answer answer = Answer::none;
            if (transfer([&]() -> I2cResult { return sensor_.write_setting(i); })) {
                answer = ask([&]() -> I2cResult { return sensor_.read_setting(i, kept); },
                             [&]() -> bool { return sensor_.setting(i).is(kept); });
            }
            if (answer == Answer::none) {
                stop(FaultCode::sensor_lost, errors_in_row_);
                return;
            }
            if (answer == Answer::wrong) {
                mismatch(i, kept);
                return;
            }
        }
        wait(State::settling, kSettleUs);
    }

    void start() {
        state_ = State::running;
        ++starts_;
        lost_instants_ = 0;
        errors_in_row_ = 0;
        equal_ = 0;
        faults_.forget_repeats();
    }

    void wait(State state, uint32_t length_us) {
        state_ = state;
        pause_.begin(clock_.now_us(), length_us);
    }

    void mismatch(size_t i, uint8_t kept) {
        const RegisterSetting& setting = sensor_.setting(i);
        doubt(FaultCode::readback_mismatch,
              static_cast<uint32_t>(setting.reg) << 16 | static_cast<uint32_t>(setting.value) << 8 | kept);
    }

    // Stops the sensor because it answers with wrong values. The I2C controller may be the cause: a byte that
    // is left in it shifts all bytes that are read later, and only recover() sets the controller up again.
    void doubt(FaultCode code, uint32_t detail) {
        stop(code, detail);
        doubtful_ = true;
    }

    void stop(FaultCode code, uint32_t detail) {
        faults_.raise(code, detail);
        state_ = State::idle;
    }

    void count_equal(const uint8_t (&burst)[Mpu9250::kBurstBytes]) {
        if (memcmp(last_, burst, sizeof last_) != 0) equal_ = 0;
        ++equal_;
        memcpy(last_, burst, sizeof last_);
    }

    uint8_t flags(const Sample& sample) const {
        uint8_t found = 0;
        if (retried_) found |= sample_flags::retried;
        if (gyro_saturated(sample)) found |= sample_flags::saturated;
        if (equal_ > 1) found |= sample_flags::repeated;
        return found;
    }

    I2cBus& bus_;
    Clock& clock_;
    Faults& faults_;
    Mpu9250 sensor_;
    Pause pause_;
    Pause between_;  // minimum time between two attempts to find or set up the sensor
    uint32_t starts_ = 0;
    uint32_t transfers_ = 0;
    uint32_t i2c_errors_ = 0;
    uint32_t bus_recoveries_ = 0;
    uint32_t errors_in_row_ = 0;
    State state_ = State::idle;
    HeldLines held_ = HeldLines::none;
    uint8_t lost_instants_ = 0;
    uint8_t who_am_i_ = 0;
    bool retried_ = false;  // whether a transfer was repeated in this step
    bool doubtful_ = false;
    bool unanswered_ = false;  // whether the last probe got no answer
    // number of equal consecutive bursts, including the last one; 0 before the first burst after a set-up
    uint8_t equal_ = 0;
    uint8_t last_[Mpu9250::kBurstBytes] = {};
};

}  // namespace fltea
