// Tests of the checks by which the device notices a bad state of the chip: lost settings, flipped bits, and
// values that stop changing.
#include <doctest/doctest.h>

#include "rig.h"

using fltea::FaultCode;
using fltea::HeldLines;
using fltea::I2cResult;
using fltea::SamplingMode;

TEST_CASE("recovery: a brown-out without a word: no sample with a wrong scale, the register is named") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        Rig rig(mode);
        rig.start_and_settle();
        rig.run(2 * kS);
        rig.chip.power_up();
        rig.run(3 * kS);
        for (const Frame& frame : rig.samples()) {
            REQUIRE(message_of<fltea::Sample>(frame).gyro_x != kWrong);
        }
        // In data-ready mode, a chip that stops also gives no more edges, and the device notices that first.
        if (mode == SamplingMode::timer) {
            CHECK(rig.fault_count(FaultCode::readback_mismatch) == 1);
            CHECK(rig.fault_detail(FaultCode::readback_mismatch) == 0x1A0100);
        } else {
            CHECK(rig.fault_count(FaultCode::data_ready_missing) == 1);
        }
        CHECK(rig.hello().sensor_starts == 2);
        check_balance(rig);
    }
}

TEST_CASE("recovery: each register of the guard is guarded") {
    for (uint8_t reg : {0x19, 0x1A, 0x1B, 0x1C, 0x1D}) {
        CAPTURE(int(reg));
        Rig rig;
        rig.start_and_settle();
        const uint8_t value = rig.chip.reg(reg) ^ 0x08;
        rig.chip.write(reg, value);
        rig.run(3 * kS);
        CHECK(rig.fault_count(FaultCode::readback_mismatch) == 1);
        CHECK((rig.fault_detail(FaultCode::readback_mismatch) >> 16) == reg);
        CHECK((rig.fault_detail(FaultCode::readback_mismatch) & 0xFF) == value);
        CHECK(rig.status().sensor_reinits == 1);
        check_balance(rig);
    }
}

TEST_CASE("recovery: one flipped bit in a guard costs its sample, the same bit twice is believed") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (int flips : {1, 2}) {
            Rig rig(mode);
            rig.start_and_settle();
            rig.bus.flip_reg = 0x19;
            rig.bus.flips = flips;
            rig.run(3 * kS);
            CHECK(rig.bus.flips == 0);
            CHECK(rig.fault_count(FaultCode::readback_mismatch) == flips - 1);
            CHECK(rig.faults().size() == static_cast<size_t>(flips - 1));
            CHECK(rig.hello().sensor_starts == flips);
            CHECK(rig.status().i2c_errors == (flips == 1 ? 1 : 0));
            if (flips == 1) CHECK(rig.status().overruns == 1);
            check_balance(rig);
        }
    }
}

TEST_CASE("recovery: a mismatch after two lost instants is told as what it is, and as nothing else") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    rig.bus.fail(I2cResult::nack, 4);
    rig.run(20 * kMs);
    rig.chip.power_up();
    rig.run(2 * kS);
    CHECK(rig.fault_count(FaultCode::readback_mismatch) == 1);
    CHECK(rig.faults().size() == 1);
    check_balance(rig);
}

TEST_CASE("recovery: a bus that flips a bit in every first guard is set up again, and it is said") {
    Rig rig;
    rig.start_and_settle();
    int reads = 0;
    rig.bus.tamper = [&](uint8_t reg, uint8_t* data) {
        if (reg == 0x19 && reads < 6 && reads++ % 2 == 0) data[0] ^= 0x01;
    };
    rig.run(2 * kS);
    CHECK(reads == 6);
    CHECK(rig.fault_count(FaultCode::sensor_lost) == 1);
    CHECK(rig.fault_detail(FaultCode::sensor_lost) == 3);
    CHECK(rig.status().i2c_errors == 3);
    CHECK(rig.hello().sensor_starts == 2);
    check_balance(rig);
}

TEST_CASE("recovery: a second guard that fails costs the sample, or the sensor if it stays") {
    Rig rig;
    rig.start_and_settle();
    rig.bus.flip_reg = 0x19;
    rig.bus.flips = 1;
    rig.bus.fail(I2cResult::ok, 2);
    rig.bus.fail(I2cResult::nack, 2);
    rig.run(1 * kS);
    CHECK(rig.status().i2c_errors == 2);
    CHECK(rig.status().overruns == 1);
    CHECK(rig.faults().empty());
    check_balance(rig);
}

TEST_CASE(
    "recovery: a byte left in the controller shifts every read: the bus is made again before the set-up") {
    enum class Begins { before_boot, in_set_up, in_samples };
    for (Begins begins : {Begins::before_boot, Begins::in_set_up, Begins::in_samples}) {
        CAPTURE(int(begins));
        Rig rig;
        rig.bus.stale = begins == Begins::before_boot;
        bool begun = begins != Begins::in_set_up;
        rig.before_step = [&] {
            if (begun || rig.bus.written.empty()) return;
            rig.bus.stale = begun = true;
        };
        if (begins == Begins::in_samples) {
            rig.start_and_settle();
            rig.bus.stale = true;
        } else {
            rig.start();
        }
        rig.run(2 * kS);
        CHECK_FALSE(rig.bus.stale);
        CHECK(rig.bus.recoveries == 1);
        CHECK(rig.status().bus_recoveries == 0);
        // A byte that is left in the controller shifts the bytes of later reads. The set-up still succeeds:
        // it reads one register at a time, and the repeated read of a register gives the right byte. Then the
        // first read of the guard registers, which reads several bytes, detects the error.
        CHECK(rig.status().i2c_errors == (begins == Begins::in_set_up ? 6 : 0));
        CHECK(rig.hello().sensor_starts == (begins == Begins::before_boot ? 1 : 2));
        CHECK(rig.hello().who_am_i == 0x71);
        const FaultCode code =
            begins == Begins::before_boot ? FaultCode::sensor_unknown : FaultCode::readback_mismatch;
        CHECK(rig.fault_count(code) == 1);
        CHECK(rig.faults().size() == 1);
        for (const Frame& frame : rig.samples()) {
            REQUIRE(message_of<fltea::Sample>(frame).accel_z == 16384);
        }
        check_balance(rig);
    }
}

TEST_CASE("recovery: the bus is made again once for each doubt, and not for a sensor that was lost") {
    Rig rig;
    rig.start_and_settle();
    rig.chip.power_up();
    rig.run(2 * kS);
    CHECK(rig.bus.recoveries == 1);
    // each pair of failures (a transfer and its repetition) leads to a recovery of the bus
    rig.bus.fail(I2cResult::nack, 6);
    rig.run(2 * kS);
    CHECK(rig.hello().sensor_starts == 3);
    CHECK(rig.bus.recoveries == 1 + 3);
}

TEST_CASE("recovery: ten equal bursts in a row are no data: said, and the sensor set up again") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        Rig rig(mode);
        rig.calls = Rig::Calls::every_tick;
        rig.start_and_settle();
        rig.run(1 * kS);
        const size_t n = rig.samples().size();
        rig.chip.stopped = true;
        rig.run(100 * kMs);
        // Since the chip stopped, all bursts equal the last one before. Together with that one, the ninth of
        // them is the tenth equal burst in a row, and is not sent.
        REQUIRE(rig.samples().size() == n + 8);
        for (size_t i = n; i < n + 8; ++i) {
            CHECK(message_of<fltea::Sample>(rig.samples()[i]).flags == fltea::sample_flags::repeated);
        }
        CHECK(rig.fault_count(FaultCode::sensor_frozen) == 1);
        CHECK(rig.fault_detail(FaultCode::sensor_frozen) == 10);
        rig.run(2 * kS);
        CHECK(rig.hello().sensor_starts == 2);
        CHECK(rig.faults().size() == 1);
        CHECK(last_flags(rig) == 0);
        check_balance(rig);
    }
}

TEST_CASE("recovery: nine equal bursts in a row are data, and a row ends with the first that differs") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    for (int row = 0; row < 3; ++row) {
        rig.chip.stopped = true;
        rig.run(80 * kMs);
        rig.chip.stopped = false;
        rig.run(10 * kMs);
    }
    rig.run(1 * kS);
    CHECK(rig.faults().empty());
    CHECK(rig.status().overruns == 0);
}

TEST_CASE("recovery: equal bursts count on over instants that were lost, and again after a set-up") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    rig.chip.stopped = true;
    rig.run(40 * kMs);
    rig.bus.fail(I2cResult::nack, 2);
    rig.run(60 * kMs);
    CHECK(rig.fault_count(FaultCode::sensor_frozen) == 1);

    // If the values never change again, the device reports that about once a second by a FAULT, and sends at
    // most nine samples after each set-up.
    rig.chip.frozen = true;
    const size_t n = rig.samples().size();
    rig.run(10 * kS);
    const int faults = rig.fault_count(FaultCode::sensor_frozen);
    CHECK(faults >= 9);
    CHECK(faults <= 11);
    CHECK(rig.samples().size() - n <= 9u * (rig.hello().sensor_starts - 1u));
}
