// Tests of all faults of the I2C bus: how many samples a fault costs, how the device counts it, and what it
// reports. Faults of the chip are tested in test_guard.cpp.
#include <doctest/doctest.h>

#include "rig.h"

using fltea::FaultCode;
using fltea::HeldLines;
using fltea::I2cResult;
using fltea::SamplingMode;

TEST_CASE("recovery: one failed transfer costs no sample; it is flagged and counted") {
    for (I2cResult result : {I2cResult::nack, I2cResult::timeout, I2cResult::short_read}) {
        // Number of good transfers before the one that fails. With 0, the reading of the sample (the burst)
        // fails. With 1, the reading after it fails, of the registers that show a changed setting.
        for (size_t at : {0, 1}) {
            Rig rig;
            rig.start_and_settle();
            rig.bus.fail(I2cResult::ok, at);
            rig.bus.fail(result, 1);
            const size_t n = rig.samples().size();
            rig.run(10 * kMs);
            CHECK(rig.samples().size() == n + 1);
            CHECK((last_flags(rig) & fltea::sample_flags::retried) != 0);
            rig.run(10 * kMs);
            CHECK(last_flags(rig) == 0);
            rig.run(1 * kS);
            const fltea::Status status = rig.status();
            CHECK(status.i2c_errors == 1);
            CHECK(status.overruns == 0);
            CHECK(status.bus_recoveries == (result == I2cResult::nack ? 0 : 1));
            CHECK(rig.bus.recoveries == (result == I2cResult::nack ? 0 : 1));
            CHECK(rig.faults().empty());
        }
    }
}

TEST_CASE("recovery: two failed transfers cost one sample, and the bus is freed") {
    for (I2cResult result : {I2cResult::nack, I2cResult::timeout}) {
        for (size_t between : {0, 1}) {
            Rig rig;
            rig.start_and_settle();
            rig.bus.fail(result, 1);
            rig.bus.fail(I2cResult::ok, between);
            rig.bus.fail(result, 1);
            rig.run(1200 * kMs);
            CHECK(rig.status().i2c_errors == 2);
            CHECK(rig.status().overruns == 1);
            CHECK(rig.bus.recoveries == (result == I2cResult::nack ? 1 : 2));
            CHECK(rig.status().bus_recoveries == (result == I2cResult::nack ? 0 : 2));
            CHECK(rig.faults().empty());
            check_balance(rig);
        }
    }
}

TEST_CASE("recovery: instants lost one by one never begin a set-up, three in a row do") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    for (int i = 0; i < 10; ++i) {
        rig.bus.fail(I2cResult::nack, 4);
        rig.run(40 * kMs);
    }
    CHECK(rig.hello().sensor_starts == 1);
    rig.bus.fail(I2cResult::nack, 6);
    rig.run(30 * kMs);
    CHECK(rig.fault_count(FaultCode::sensor_lost) == 1);
    CHECK(rig.fault_detail(FaultCode::sensor_lost) == 6);
    rig.run(2 * kS);
    CHECK(rig.hello().sensor_starts == 2);
    CHECK(rig.status().sensor_reinits == 1);
    check_balance(rig);
}

TEST_CASE("recovery: lost again before its first sample, it is set up again") {
    Rig rig;
    rig.start_and_settle();
    rig.run(1 * kS);
    rig.bus.fail(I2cResult::nack, 6);
    for (int ms = 0; ms < 1000 && rig.hello().sensor_starts == 1; ++ms) rig.run(1 * kMs);
    REQUIRE(rig.hello().sensor_starts == 2);
    rig.bus.fail(I2cResult::nack, 6);
    rig.run(2 * kS);
    CHECK(rig.fault_count(FaultCode::sensor_lost) == 2);
    CHECK(rig.fault_detail(FaultCode::sensor_lost) == 6);
    CHECK(rig.hello().sensor_starts == 3);
    CHECK((rig.clock.us() - rig.samples().back().device_us) < 20 * kMs);
    check_balance(rig);
}

TEST_CASE("recovery: after lost instants the set-up has its own second try") {
    Rig rig;
    rig.start_and_settle();
    rig.bus.fail(I2cResult::nack, 7);
    rig.run(3 * kS);
    CHECK(rig.fault_count(FaultCode::sensor_missing) == 0);
    CHECK(rig.hello().sensor_starts == 2);
}

TEST_CASE("recovery: the first sample after a set-up repeats nothing") {
    Rig rig;
    rig.start_and_settle();
    rig.chip.frozen = true;
    rig.before_step = [&] { rig.chip.life = 1; };
    rig.run(50 * kMs);
    rig.chip.power_up();
    const size_t n = rig.samples().size();
    for (int ms = 0; ms < 2000 && rig.samples().size() < n + 2; ++ms) rig.run(1 * kMs);
    REQUIRE(rig.samples().size() == n + 2);
    CHECK(rig.hello().sensor_starts == 2);
    CHECK(message_of<fltea::Sample>(rig.samples()[n]).flags == 0);
    CHECK(message_of<fltea::Sample>(rig.samples()[n + 1]).flags == fltea::sample_flags::repeated);
}

TEST_CASE("recovery: lost one wrap of the clock after its set-up began, it need not wait") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start();
    rig.run((UINT64_C(1) << 32) + 100 * kMs);
    rig.chip.power_up();
    rig.run(400 * kMs);
    CHECK(rig.hello().sensor_starts == 2);
}

TEST_CASE("recovery: a sensor that holds SDA in mid-byte is freed within the same instant") {
    Rig rig;
    rig.start_and_settle();
    rig.bus.held = HeldLines::sda;
    rig.bus.clocks_to_free = 1;
    rig.run(1200 * kMs);
    CHECK(rig.status().i2c_errors == 1);
    CHECK(rig.status().bus_recoveries == 1);
    CHECK(rig.status().overruns == 0);
    CHECK(rig.faults().empty());
}

TEST_CASE("recovery: lines held for good: said once a second, and all goes on when they are let go") {
    for (HeldLines held : {HeldLines::sda, HeldLines::scl, HeldLines::both}) {
        for (bool at_boot : {false, true}) {
            Rig rig;
            rig.calls = Rig::Calls::every_tick;
            if (!at_boot) rig.start_and_settle();
            rig.bus.held = held;
            rig.bus.clocks_to_free = -1;
            if (at_boot) rig.start();
            rig.run(5 * kS + 500 * kMs);
            CHECK(rig.fault_count(FaultCode::bus_held) == 6);
            CHECK(rig.fault_detail(FaultCode::bus_held) == static_cast<uint32_t>(held));
            CHECK(rig.fault_count(FaultCode::sensor_missing) == 0);
            CHECK(rig.status().bus_recoveries == 0);
            // The detail of sensor_lost is the number of failed transfers: one at each of three sampling
            // instants. Transfers are not repeated while a line is held, since this would be useless.
            CHECK(rig.fault_detail(FaultCode::sensor_lost) == (at_boot ? 0 : 3));
            rig.bus.held = HeldLines::none;
            rig.run(3 * kS);
            CHECK(rig.hello().sensor_starts == (at_boot ? 1 : 2));
            check_balance(rig);
        }
    }
}

TEST_CASE("recovery: a FAULT says when it was made, after the time-out that it tells of") {
    Rig rig;
    rig.start();
    rig.clock.pass(10 * kMs);
    rig.bus.held = HeldLines::scl;
    rig.application.step();
    CHECK(rig.faults().size() == 1);
    CHECK(rig.faults()[0].device_us == rig.clock.now_us());
    CHECK(rig.clock.us() == 10 * kMs + fltea::settings::kI2cTimeoutUs + kRecoverUs);
}

TEST_CASE("recovery: absent at boot, plugged in after minutes: said once a second, then numbered from 0") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        Rig rig(mode);
        rig.calls = Rig::Calls::every_tick;
        rig.bus.plugged = false;
        rig.start();
        rig.run(180 * kS + 500 * kMs);
        CHECK(rig.fault_count(FaultCode::sensor_missing) >= 170);
        CHECK(rig.fault_count(FaultCode::sensor_missing) <= 181);
        CHECK(rig.fault_detail(FaultCode::sensor_missing) == 0x68);
        CHECK(rig.hello().who_am_i == 0);
        CHECK(rig.hello().sensor_starts == 0);
        CHECK(rig.status().overruns == 0);
        CHECK(rig.status().sensor_reinits == 0);
        rig.bus.plugged = true;
        rig.chip.power_up();
        rig.run(3 * kS);
        REQUIRE_FALSE(rig.samples().empty());
        CHECK(rig.samples()[0].sequence == 0);
        CHECK(rig.hello().sensor_starts == 1);
        check_balance(rig);
    }
}

TEST_CASE("recovery: unplugged and plugged in again: a new start, said by HELLO before the first sample") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        Rig rig(mode);
        rig.start_and_settle();
        const size_t frames = rig.sink.receiver.frames.size();
        const size_t samples = rig.samples().size();
        rig.bus.plugged = false;
        rig.chip.quiet = true;
        rig.run(20 * kS);
        CHECK(rig.fault_count(FaultCode::sensor_missing) >= 18);
        CHECK(rig.samples().size() == samples);
        // sampling instants are counted while the sensor is unplugged, too
        CHECK(rig.status().overruns > 1900);
        rig.bus.plugged = true;
        rig.chip.quiet = false;
        rig.chip.power_up();
        rig.run(3 * kS);
        REQUIRE(rig.samples().size() > samples);
        bool announced = false;
        for (size_t i = frames; rig.sink.receiver.frames[i].type != fltea::Sample::type(); ++i) {
            const Frame& frame = rig.sink.receiver.frames[i];
            if (frame.type != fltea::Hello::type()) continue;
            announced = message_of<fltea::Hello>(frame).sensor_starts == 2;
        }
        CHECK(announced);
        // Every sampling instant has its own sequence number, also while the sensor was absent.
        const std::vector<Frame> all = rig.samples();
        const double instants = static_cast<double>(all.back().device_us - all[0].device_us) / 10000.0;
        CHECK(static_cast<double>(all.back().sequence) == doctest::Approx(instants).epsilon(0.001));
        CHECK(rig.status().sensor_reinits == 1);
        check_balance(rig);
    }
}

TEST_CASE("recovery: another chip in its place is set up as what it is") {
    Rig rig;
    rig.start_and_settle();
    rig.bus.plugged = false;
    rig.run(100 * kMs);
    rig.bus.plugged = true;
    rig.chip.who_am_i = 0x68;
    rig.chip.power_up();
    rig.run(3 * kS);
    CHECK(rig.hello().who_am_i == 0x68);
    CHECK(rig.hello().gyro_dlpf == 188);
    CHECK(rig.chip.as_wanted());
    CHECK(rig.hello().sensor_starts == 2);
}

TEST_CASE(
    "recovery: a sensor that is back is found within a tenth of a second, and nothing old is told after") {
    Rig rig;
    rig.start_and_settle();
    rig.run(2 * kS);
    const Frame before = rig.samples().back();
    const size_t n = rig.samples().size();
    rig.bus.plugged = false;
    rig.run(1350 * kMs);
    rig.bus.plugged = true;
    rig.chip.power_up();
    const size_t faults = rig.faults().size();
    rig.run(2 * kS);
    REQUIRE(rig.samples().size() > n);
    // In milliseconds: the sensor was absent for 1,350, it is probed every 100, reset and settling of the
    // chip take 160, and 30 are a margin.
    CHECK(rig.samples()[n].device_us - before.device_us < (1350 + 100 + 160 + 30) * kMs);
    CHECK(rig.faults().size() == faults);
    check_balance(rig);
}

TEST_CASE("recovery: set-ups begin a second apart, even of a chip that never stays as it was set") {
    Rig rig;
    rig.start();
    rig.before_step = [&] {
        if (!rig.samples().empty() && rig.chip.as_wanted()) rig.chip.power_up();
    };
    rig.run(10 * kS + 500 * kMs);
    CHECK(rig.hello().sensor_starts == 11);
    CHECK(rig.fault_count(FaultCode::readback_mismatch) <= 11);
}

TEST_CASE(
    "recovery: no edge on the pin: said with the silence, set up again every second, then samples as "
    "before") {
    Rig rig(SamplingMode::data_ready);
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    rig.run(2 * kS);
    const Frame before = rig.samples().back();
    rig.chip.quiet = true;
    rig.run(60 * kMs);
    CHECK(rig.fault_count(FaultCode::data_ready_missing) == 1);
    CHECK(rig.fault_detail(FaultCode::data_ready_missing) >= 50000);
    CHECK(rig.fault_detail(FaultCode::data_ready_missing) < 61000);
    rig.run(5 * kS);
    CHECK(rig.fault_count(FaultCode::data_ready_missing) >= 5);
    CHECK(rig.samples().back().sequence == before.sequence);
    const size_t n = rig.samples().size();
    rig.chip.quiet = false;
    rig.run(3 * kS);
    const Frame after = rig.samples()[n];
    const double instants = static_cast<double>(after.device_us - before.device_us) / 10000.0;
    CHECK(static_cast<double>(after.sequence - before.sequence) == doctest::Approx(instants).epsilon(0.003));
    check_balance(rig);
}

TEST_CASE("recovery: in data-ready mode an edge during a failed read gives its own stamp to the second one") {
    Rig rig(SamplingMode::data_ready);
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    // The read begins 8 ms after its edge and fails 3 ms later. The next edge comes during this read, 10 ms
    // after the first edge.
    const Frame before = rig.samples().back();
    rig.clock.pass(before.device_us + 18 * kMs - rig.clock.us());
    rig.edges();
    rig.bus.fail(I2cResult::timeout, 1);
    rig.application.step();
    const Frame after = rig.samples().back();
    CHECK(after.device_us == before.device_us + 20000);
    CHECK(after.sequence == before.sequence + 2);
    rig.run(1 * kS);
    check_balance(rig);
}

TEST_CASE("recovery: a sensor gone for longer than the clock's wrap comes back") {
    for (uint64_t hours_us : {UINT64_C(1) << 31, UINT64_C(1) << 32, (UINT64_C(1) << 32) + 700 * kMs}) {
        Rig rig;
        rig.calls = Rig::Calls::every_tick;
        rig.sink.size = 127;
        rig.start_and_settle();
        const Frame before = rig.samples().back();
        rig.bus.plugged = false;
        rig.run(hours_us);
        rig.bus.plugged = true;
        rig.run(3 * kS);
        CHECK(rig.hello().sensor_starts == 2);
        const std::vector<Frame> samples = rig.samples();
        CHECK(last_flags(rig) == 0);
        const uint64_t instants = (rig.clock.us() - before.device_us) / kPeriodUs;
        CHECK(static_cast<uint16_t>(samples.back().sequence - before.sequence) ==
              static_cast<uint16_t>(instants - 1));
        const double seconds = static_cast<double>(hours_us) * 1e-6;
        CHECK(rig.fault_count(FaultCode::sensor_missing) > seconds * 0.95);
        CHECK(rig.sink.of<fltea::Status>().size() > seconds * 0.999);
    }
}
