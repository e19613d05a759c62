// The sensor's care: sets it up, reads it, and brings it back. A failed transfer is tried once more, and nine
// clocks free the bus if it may be held. After a few lost instants, a register that is not as it was set, or
// values that stand still, the chip is set up again, at most once a second until it runs. No call outlasts
// two failing transfers, three recoveries and those transfers of a set-up that work: 10 ms.
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

// HELLO's sensor_starts: after 65535 comes 1, as 0 is "not yet".
constexpr uint16_t start_number(uint32_t starts) {
    return static_cast<uint16_t>(starts == 0 ? 0 : (starts - 1) % 65535 + 1);
}

class Health {
  public:
    struct Reading {
        Sample sample;      // with the flags retried, saturated and repeated
        uint32_t burst_us;  // just before the burst began
    };

    Health(I2cBus& bus, Clock& clock, Faults& faults, SamplingMode mode)
        : bus_(bus), clock_(clock), faults_(faults), sensor_(bus, mode) {}

    // In every step.
    void pass_time(uint32_t now_us) { between_.over(now_us); }

    bool running() const { return state_ == State::running; }

    // Transfers so far, with those that failed; wraps.
    uint32_t transfers() const { return transfers_; }

    // In every step while the sensor does not run: goes on with the set-up. True when it is complete.
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

    // One instant of a running sensor. False: nothing to send; set_up() does what is needed.
    bool read(Reading& reading) {
        uint8_t burst[Mpu9250::kBurstBytes];
        retried_ = false;
        const bool done = transfer([&]() -> I2cResult {
            reading.burst_us = clock_.now_us();
            return sensor_.read_burst(burst);
        });
        // Checked after the burst, so that a chip that came back from a reset before it is found out.
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

    // The sensor answers but gives no edges.
    void data_ready_missing(uint32_t silence_us) { stop(FaultCode::data_ready_missing, silence_us); }

    // As HELLO and STATUS want them.
    uint8_t who_am_i() const { return who_am_i_; }
    uint16_t sensor_starts() const { return start_number(starts_); }
    uint32_t sensor_reinits() const { return starts_ == 0 ? 0 : starts_ - 1; }
    uint32_t i2c_errors() const { return i2c_errors_; }
    uint32_t bus_recoveries() const { return bus_recoveries_; }

  private:
    enum class State : uint8_t { idle, resetting, settling, running };

    // What became of a question about the chip's settings.
    enum class Answer : uint8_t { right, right_at_second, wrong, none };

    // Three instants in a row, and 30 ms, are more than a disturbance and less than the host's patience.
    static constexpr uint8_t kLostInstants =
        settings::kSamplePeriodUs < 10000 ? 30000 / settings::kSamplePeriodUs : 3;
    // The noise of seven channels does not stand still; a chip asleep does, and keeps its settings.
    static constexpr uint8_t kMostEqual = 10;
    // After a reset the registers answer like after power-up: within 100 ms (PS-MPU-9250A-01, start-up time).
    static constexpr uint32_t kResetUs = 100000;
    // The gyroscope needs 35 ms from sleep (PS-MPU-9250A-01, 3.1), where an MPU-6050 is after its reset.
    static constexpr uint32_t kSettleUs = 50000;

    // How often a missing sensor is asked for. Set-ups are a second apart: a chip that fails them needs no
    // haste.
    static constexpr uint32_t kProbeUs = 100000;

    // Tries a transfer, and again if it is the first of this step that fails.
    template <typename Transfer>
    bool transfer(Transfer go) {
        for (;;) {
            ++transfers_;
            const I2cResult result = go();
            if (result == I2cResult::ok) return true;
            count_error();
            const bool again = !retried_;
            retried_ = true;
            // A NACK comes over a bus that works: ask again before freeing it.
            if (result != I2cResult::nack || !again) {
                if (!recover(result)) return false;
            }
            if (!again) return false;
        }
    }

    // False: lines are still held.
    bool recover(I2cResult result) {
        held_ = bus_.recover();
        if (held_ != HeldLines::none) {
            faults_.raise(FaultCode::bus_held, static_cast<uint32_t>(held_));
            return false;
        }
        if (result != I2cResult::nack) ++bus_recoveries_;
        return true;
    }

    // I2C has no checksum: a wrong answer may be a bit that flipped on the wires, and is asked for once more.
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

    // Whether the burst can be believed: the chip is as it was set, and says so at once.
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
            // The board is up before a sensor that gets its supply with it (11 to 100 ms:
            // PS-MPU-9250A-01, 3.4.2).
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

    // The sensor answers, but not as it should. That may be the controller's doing: a byte left in it shifts
    // all that is read, and only recover() sets it up again.
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
    Pause between_;  // probes, and set-ups, begin that far apart
    uint32_t starts_ = 0;
    uint32_t transfers_ = 0;
    uint32_t i2c_errors_ = 0;
    uint32_t bus_recoveries_ = 0;
    uint32_t errors_in_row_ = 0;
    State state_ = State::idle;
    HeldLines held_ = HeldLines::none;
    uint8_t lost_instants_ = 0;
    uint8_t who_am_i_ = 0;
    bool retried_ = false;  // in this step
    bool doubtful_ = false;
    bool unanswered_ = false;  // the last probe
    uint8_t equal_ = 0;        // bursts in a row, with the last one; 0: none since the sensor runs
    uint8_t last_[Mpu9250::kBurstBytes] = {};
};

}  // namespace fltea
