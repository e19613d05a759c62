// Tests of setting up and reading each chip of the MPU-9250's family, register by register.
#include <doctest/doctest.h>

#include <map>

#include "mpu9250.h"
#include "rig.h"

using fltea::FaultCode;
using fltea::I2cResult;
using fltea::SamplingMode;

TEST_CASE("mpu9250: the known chips, and no other") {
    int known = 0;
    for (int id = 0; id < 256; ++id) known += fltea::find_sensor_kind(static_cast<uint8_t>(id)) != nullptr;
    CHECK(known == 6);
    for (uint8_t id : {0x71, 0x73, 0x70, 0x75, 0x78}) CHECK(fltea::find_sensor_kind(id)->has_accel_config_2);
    CHECK_FALSE(fltea::find_sensor_kind(0x68)->has_accel_config_2);
}

TEST_CASE(
    "mpu9250: set-up of each chip in both modes: reset, wake, registers as wanted, samples in their scale") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (uint8_t id : {0x71, 0x73, 0x70, 0x68, 0x75, 0x78}) {
            CAPTURE(int(id));
            Rig rig(mode);
            rig.chip.who_am_i = id;
            rig.chip.power_up();
            const int16_t life = rig.chip.life;
            rig.start_and_settle();
            CHECK(rig.chip.life == life + 1);  // the set-up resets the chip once
            CHECK(rig.chip.as_wanted());
            CHECK(rig.chip.reg(0x37) == 0x00);
            CHECK(rig.chip.reg(0x38) == (mode == SamplingMode::data_ready ? 1 : 0));
            std::vector<uint8_t> written = {0x6B, 0x6B, 0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x37, 0x38};
            if (id == 0x68) written.erase(written.begin() + 6);
            CHECK(rig.bus.written == written);
            CHECK(rig.faults().empty());

            const fltea::Hello hello = rig.hello();
            CHECK(hello.who_am_i == id);
            CHECK(hello.sensor_starts == 1);
            CHECK(hello.sampling_mode == mode);
            CHECK(hello.gyro_dlpf == (id == 0x68 ? 188 : 184));
        }
    }
}

TEST_CASE("mpu9250: what HELLO says of the scales") {
    Rig rig;
    rig.start_and_settle();
    const fltea::Hello hello = rig.hello();
    CHECK(hello.sample_rate == 100000);
    CHECK(hello.gyro_range == 2000);
    CHECK(hello.gyro_lsb == 164);
    CHECK(hello.accel_range == 2);
    CHECK(hello.accel_lsb == 16384);
}

TEST_CASE("mpu9250: ranges and filters of the settings") {
    CHECK(fltea::range_select(250, 250) == 0);
    CHECK(fltea::range_select(2000, 250) == 3);
    CHECK(fltea::range_select(4, 2) == 1);
    CHECK(fltea::range_select(3, 2) == 4);
    const uint16_t hz[] = {184, 92, 41, 20, 10, 5};
    for (uint8_t i = 0; i < 6; ++i) CHECK(fltea::dlpf_select(hz[i]) == i + 1);
    CHECK(fltea::dlpf_select(250) == 0);
}

TEST_CASE("mpu9250: a burst is accelerations, temperature, rates, big-endian") {
    const uint8_t burst[14] = {0x00, 0x01, 0xFF, 0xFF, 0x80, 0x00, 0x12,
                               0x34, 0x7F, 0xFE, 0x80, 0x01, 0x00, 0xFF};
    fltea::Sample sample;
    fltea::decode_burst(burst, sample);
    CHECK(sample.accel_x == 1);
    CHECK(sample.accel_y == -1);
    CHECK(sample.accel_z == -32768);
    CHECK(sample.temperature == 0x1234);
    CHECK(sample.gyro_x == 32766);
    CHECK(sample.gyro_y == -32767);
    CHECK(sample.gyro_z == 255);
}

TEST_CASE("mpu9250: each axis saturates at each end and not one count before") {
    for (int16_t fltea::Sample::* axis :
         {&fltea::Sample::gyro_x, &fltea::Sample::gyro_y, &fltea::Sample::gyro_z}) {
        fltea::Sample sample = {};
        for (int16_t end : {INT16_MAX, INT16_MIN}) {
            sample.*axis = end;
            CHECK(fltea::gyro_saturated(sample));
            sample.*axis = static_cast<int16_t>(end > 0 ? end - 1 : end + 1);
            CHECK_FALSE(fltea::gyro_saturated(sample));
        }
    }
    fltea::Sample accelerated = {};
    accelerated.accel_x = accelerated.accel_y = accelerated.accel_z = accelerated.temperature = INT16_MAX;
    CHECK_FALSE(fltea::gyro_saturated(accelerated));
}

TEST_CASE("mpu9250: a register that takes no value is named, with what was written and what it holds") {
    for (uint8_t reg : {0x6B, 0x1A, 0x1B, 0x1D}) {
        CAPTURE(int(reg));
        Rig rig;
        rig.chip.stuck = {reg};
        if (reg == 0x6B) rig.chip.who_am_i = 0x68;  // only this chip (the MPU-6050) sleeps after its reset
        rig.start();
        rig.run(1500 * kMs);
        CHECK(rig.samples().empty());
        CHECK(rig.hello().sensor_starts == 0);
        CHECK(rig.fault_count(FaultCode::readback_mismatch) == 2);
        const uint32_t wanted = reg == 0x6B   ? 0x6B0140
                                : reg == 0x1A ? 0x1A0100
                                : reg == 0x1B ? 0x1B1800
                                              : 0x1D0100;
        CHECK(rig.fault_detail(FaultCode::readback_mismatch) == wanted);

        rig.chip.stuck.clear();
        rig.run(1500 * kMs);
        CHECK(rig.hello().sensor_starts == 1);
        CHECK_FALSE(rig.samples().empty());
    }
}

TEST_CASE("mpu9250: a chip whose bits without a meaning read 1 runs") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (uint8_t id : {0x71, 0x73, 0x70, 0x68, 0x75, 0x78}) {
            CAPTURE(int(id));
            Rig rig(mode);
            rig.chip.who_am_i = id;
            rig.chip.reserved_ones = true;
            rig.chip.power_up();
            rig.start_and_settle();
            rig.run(1 * kS);
            CHECK(rig.faults().empty());
            CHECK(rig.status().overruns == 0);
            CHECK(rig.samples().size() > 100);
        }
    }
}

TEST_CASE("mpu9250: every bit that has a meaning counts, and no other") {
    // For each register, the bits that have a meaning by the register map RM-MPU-9250A-00.
    const std::map<uint8_t, int> defined = {{0x19, 0xFF}, {0x1A, 0x7F}, {0x1B, 0xFB}, {0x1C, 0xF8},
                                            {0x1D, 0x0F}, {0x37, 0xFE}, {0x38, 0x59}, {0x6B, 0x7F}};
    FakeClock clock;
    FakeChip chip(clock);
    FakeBus bus(clock, chip);
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        const fltea::Mpu9250 sensor(bus, mode);
        for (size_t i = 0; i < fltea::Mpu9250::kSettings; ++i) {
            const fltea::RegisterSetting& setting = sensor.setting(i);
            for (int value = 0; value < 256; ++value) {
                const bool same = ((value ^ setting.value) & defined.at(setting.reg)) == 0;
                REQUIRE(setting.is(static_cast<uint8_t>(value)) == same);
            }
        }
    }
}

TEST_CASE(
    "mpu9250: one flipped bit in any readback of the set-up costs nothing, two in a row begin it again") {
    for (uint8_t reg : {0x6B, 0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x37, 0x38}) {
        for (int flips : {1, 2}) {
            CAPTURE(int(reg));
            Rig rig;
            rig.bus.flip_reg = reg;
            rig.bus.flip_mask = 0x08;
            rig.bus.flips = flips;
            rig.start();
            rig.run(600 * kMs);
            CHECK(rig.samples().empty() == (flips == 2));
            CHECK(rig.fault_count(FaultCode::readback_mismatch) == (flips == 2 ? 1 : 0));
            CHECK(rig.status().i2c_errors == (flips == 2 ? 0 : 1));
            rig.run(1 * kS);
            CHECK(rig.hello().sensor_starts == 1);
            CHECK_FALSE(rig.samples().empty());
        }
    }
}

TEST_CASE("mpu9250: an unknown chip is named and refused, and left as it is") {
    Rig rig;
    rig.chip.who_am_i = 0x12;
    rig.start();
    rig.run(3500 * kMs);
    CHECK(rig.fault_count(FaultCode::sensor_unknown) == 4);
    CHECK(rig.fault_detail(FaultCode::sensor_unknown) == 0x12);
    CHECK(rig.samples().empty());
    CHECK(rig.bus.written.empty());
    CHECK(rig.hello().who_am_i == 0x12);

    rig.chip.who_am_i = 0x70;
    rig.run(1500 * kMs);
    CHECK(rig.hello().who_am_i == 0x70);
    CHECK(rig.hello().sensor_starts == 1);
}

TEST_CASE(
    "mpu9250: a NACK, a time-out or a short read at any point of the set-up costs nothing if the next "
    "works") {
    for (I2cResult result : {I2cResult::nack, I2cResult::timeout, I2cResult::short_read}) {
        // The set-up has 18 transfers: WHO_AM_I, the reset, then a write and a read for each of eight
        // registers.
        for (size_t at = 0; at < 18; ++at) {
            CAPTURE(at);
            Rig rig;
            rig.bus.fail(I2cResult::ok, at);
            rig.bus.fail(result, 1);
            rig.start_and_settle();
            CHECK(rig.faults().empty());
            CHECK(rig.hello().sensor_starts == 1);
            CHECK(rig.bus.recoveries == (result == I2cResult::nack ? 0 : 1));
        }
    }
}

TEST_CASE(
    "mpu9250: two failures in one step of the set-up begin it again, soon and quietly if nobody answered") {
    for (I2cResult result : {I2cResult::nack, I2cResult::timeout, I2cResult::short_read}) {
        for (size_t at = 0; at < 18; ++at) {
            CAPTURE(at);
            Rig rig;
            rig.bus.fail(I2cResult::ok, at);
            rig.bus.fail(result, 2);
            rig.start();
            rig.run((at == 0 ? 90 : 900) * kMs);
            CHECK(rig.samples().empty());
            CHECK(rig.faults().size() == (at == 0 ? 0 : 1));
            if (at > 0) CHECK(rig.fault_detail(FaultCode::sensor_lost) == 2);
            rig.run(300 * kMs);
            CHECK_FALSE(rig.samples().empty());
            CHECK(rig.hello().sensor_starts == 1);
            CHECK(rig.faults().size() == (at == 0 ? 0 : 1));
        }
    }
}

TEST_CASE("mpu9250: a sensor that powers up more slowly than the board is not missing") {
    for (uint64_t late_us : {11 * kMs, 100 * kMs}) {
        Rig rig;
        rig.bus.plugged = false;
        rig.start();
        rig.run(late_us);
        rig.bus.plugged = true;
        rig.run(1 * kS);
        CHECK(rig.faults().empty());
        CHECK(rig.hello().sensor_starts == 1);
    }
}

TEST_CASE("mpu9250: a sensor is missing from the second probe in a row on that nobody answers") {
    Rig rig;
    rig.bus.plugged = false;
    rig.start();
    rig.run(90 * kMs);
    CHECK(rig.faults().empty());
    rig.run(20 * kMs);
    CHECK(rig.fault_count(FaultCode::sensor_missing) == 1);
    CHECK(rig.fault_detail(FaultCode::sensor_missing) == 0x68);
    // If the chip answers between two probes without an answer, the count of unanswered probes starts again.
    rig.bus.plugged = true;
    rig.run(1200 * kMs);
    REQUIRE(rig.hello().sensor_starts == 1);
    rig.bus.plugged = false;
    rig.run(100 * kMs);  // three sampling instants are lost in this time, and one probe follows
    CHECK(rig.fault_count(FaultCode::sensor_lost) == 1);
    CHECK(rig.fault_count(FaultCode::sensor_missing) == 1);
    rig.run(100 * kMs);
    CHECK(rig.fault_count(FaultCode::sensor_missing) == 2);
}

TEST_CASE("mpu9250: the longest set-up: every register is read twice, and the last one fails") {
    Rig rig;
    std::map<uint8_t, int> reads;
    rig.bus.tamper = [&](uint8_t reg, uint8_t* data) {
        if (reg != 0x75 && reads[reg]++ == 0) data[0] ^= 0x08;
    };
    rig.bus.fail(I2cResult::ok, 2 + 3 * 8 - 1);
    rig.bus.fail(I2cResult::timeout, 2);
    rig.start();
    rig.run(500 * kMs);
    CHECK(rig.bus.script.empty());
    CHECK(rig.fault_count(FaultCode::sensor_lost) == 1);
}
