// The driver of the MPU-9250 and related chips: single transfers, and how their bytes become counts. Retries
// and waits are done in health.h.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "i2c_bus.h"
#include "messages.h"
#include "mpu9250_registers.h"
#include "settings.h"

namespace fltea {

// A chip that the driver supports. host/fltea/wire/sensors.py has the names.
struct SensorKind {
    uint8_t who_am_i;
    bool has_accel_config_2;
};

// Returns the chip whose register WHO_AM_I has this value. Returns nullptr for an unknown chip, which might
// have other registers or scales.
inline const SensorKind* find_sensor_kind(uint8_t who_am_i) {
    static const SensorKind kinds[] = {
        {0x71, true},   // MPU-9250
        {0x73, true},   // MPU-9255
        {0x70, true},   // MPU-6500
        {0x68, false},  // MPU-6050
        {0x75, true},   // clone of the MPU-9250
        {0x78, true},   // clone of the MPU-9250
    };
    for (const SensorKind& kind : kinds) {
        if (kind.who_am_i == who_am_i) return &kind;
    }
    return nullptr;
}

// Returns the register field FS_SEL for a full scale. The full scale doubles with each step of FS_SEL. A
// result of 4 or more means that there is no such full scale.
constexpr uint8_t range_select(uint16_t range, uint16_t smallest) {
    return range == smallest       ? 0
           : range == smallest * 2 ? 1
           : range == smallest * 4 ? 2
           : range == smallest * 8 ? 3
                                   : 4;
}

// Returns the register field DLPF_CFG for a bandwidth [Hz] of the low-pass filter. A result of 0 means that
// there is no such filter at an internal rate of 1 kHz.
constexpr uint8_t dlpf_select(uint16_t hz) {
    return hz == 184 ? 1 : hz == 92 ? 2 : hz == 41 ? 3 : hz == 20 ? 4 : hz == 10 ? 5 : hz == 5 ? 6 : 0;
}

constexpr uint8_t kGyroSelect = range_select(settings::kGyroRangeDps, 250);
constexpr uint8_t kAccelSelect = range_select(settings::kAccelRangeG, 2);
constexpr uint8_t kDlpfSelect = dlpf_select(settings::kDlpfHz);

static_assert(kGyroSelect < 4, "kGyroRangeDps must be 250, 500, 1000 or 2000");
static_assert(kAccelSelect < 4, "kAccelRangeG must be 2, 4, 8 or 16");
static_assert(kDlpfSelect != 0, "kDlpfHz must be 184, 92, 41, 20, 10 or 5");
static_assert(settings::kSamplePeriodUs % 1000 == 0 && settings::kSamplePeriodUs >= 1000 &&
                  settings::kSamplePeriodUs <= 256000,
              "kSamplePeriodUs must be 1 to 256 whole milliseconds");

// Returns the gyroscope's sensitivity in tenths of a count per deg/s. In counts, it is 131.0, 65.5, 32.8 or
// 16.4 per deg/s (data sheet PS-MPU-9250A-01, 3.1).
constexpr uint16_t kGyroLsbTenths = kGyroSelect == 0   ? 1310
                                    : kGyroSelect == 1 ? 655
                                    : kGyroSelect == 2 ? 328
                                                       : 164;
// Returns the accelerometer's sensitivity [counts per g] (data sheet PS-MPU-9250A-01, 3.2).
constexpr uint16_t kAccelLsb = 16384 >> kAccelSelect;

// Bandwidth of the gyroscope's filter [Hz]; the MPU-6050's differs slightly (its register map
// RM-MPU-6000A-00, register 26).
inline uint16_t gyro_dlpf_hz(uint8_t who_am_i) {
    static const uint16_t mpu6050[] = {188, 98, 42, 20, 10, 5};
    return who_am_i == 0x68 ? mpu6050[kDlpfSelect - 1] : settings::kDlpfHz;
}

// Returns the value of the register SMPLRT_DIV. In timer mode, conversions run at the full internal rate of 1
// kHz, so that the newest conversion is never old. In data-ready mode, there is one conversion per period.
constexpr uint8_t rate_divider(SamplingMode mode) {
    return mode == SamplingMode::data_ready ? settings::kSamplePeriodUs / 1000 - 1 : 0;
}

// Returns the value of the register INT_ENABLE.
constexpr uint8_t interrupt_enable(SamplingMode mode) {
    return mode == SamplingMode::data_ready ? mpu9250_reg::kRawReady : 0;
}

// A setting of the chip: the value of a register, and which of its bits are compared when the register is
// read back. Bits without a meaning may have any value on a clone, and the reset bit H_RESET clears itself.
struct RegisterSetting {
    uint8_t reg;
    uint8_t value;
    uint8_t meaning;

    bool is(uint8_t kept) const { return ((kept ^ value) & meaning) == 0; }
};

class Mpu9250 {
  public:
    static constexpr size_t kBurstBytes = 14;
    static constexpr size_t kGuardBytes = 5;
    static constexpr size_t kSettings = 8;

    Mpu9250(I2cBus& bus, SamplingMode mode)
        : bus_(bus),
          settings_{
              {mpu9250_reg::kPwrMgmt1, mpu9250_reg::kPllClock, 0x7F},
              {mpu9250_reg::kSmplrtDiv, rate_divider(mode), 0xFF},
              {mpu9250_reg::kConfig, kDlpfSelect, 0x7F},
              {mpu9250_reg::kGyroConfig, kGyroSelect << mpu9250_reg::kRangeShift, 0xFB},
              {mpu9250_reg::kAccelConfig, kAccelSelect << mpu9250_reg::kRangeShift, 0xF8},
              {mpu9250_reg::kAccelConfig2, kDlpfSelect, 0x0F},
              {mpu9250_reg::kIntPinCfg, mpu9250_reg::kPulseHigh, 0xFE},
              {mpu9250_reg::kIntEnable, interrupt_enable(mode), 0x59},
          } {}

    I2cResult read_who_am_i(uint8_t& who_am_i) {
        return bus_.read(settings::kSensorAddress, mpu9250_reg::kWhoAmI, &who_am_i, 1);
    }

    // Sets which kind of chip the following transfers are for.
    void set_kind(const SensorKind& kind) { has_accel_config_2_ = kind.has_accel_config_2; }

    // Resets every register (register map RM-MPU-9250A-00, section 4.34). The caller has to wait before the
    // next transfer, as health.h does.
    I2cResult start_reset() {
        return bus_.write(settings::kSensorAddress, mpu9250_reg::kPwrMgmt1, mpu9250_reg::kReset);
    }

    // Returns the i-th of the kSettings settings, in the order in which they have to be written. The first
    // setting wakes the chip.
    const RegisterSetting& setting(size_t i) const { return settings_[i]; }

    // Whether the chip has the register of the i-th setting.
    bool has_setting(size_t i) const {
        return has_accel_config_2_ || settings_[i].reg != mpu9250_reg::kAccelConfig2;
    }

    I2cResult write_setting(size_t i) {
        return bus_.write(settings::kSensorAddress, settings_[i].reg, settings_[i].value);
    }

    I2cResult read_setting(size_t i, uint8_t& value) {
        return bus_.read(settings::kSensorAddress, settings_[i].reg, &value, 1);
    }

    // Reads all channels of one conversion in one transfer, so that they belong together.
    I2cResult read_burst(uint8_t (&burst)[kBurstBytes]) {
        return bus_.read(settings::kSensorAddress, mpu9250_reg::kAccelXoutH, burst, kBurstBytes);
    }

    // Reads the guard registers, which determine the scale and bandwidth of a sample.
    I2cResult read_guard(uint8_t (&guard)[kGuardBytes]) {
        return bus_.read(settings::kSensorAddress, mpu9250_reg::kSmplrtDiv, guard, guard_size());
    }

    // Returns the index of the first setting that differs from what read_guard() has read, or kSettings if
    // none differs. The check is needed because a chip that lost its supply for a moment still answers, but
    // with other ranges and filters.
    size_t first_mismatch(const uint8_t (&guard)[kGuardBytes]) const {
        for (size_t i = 0; i < guard_size(); ++i) {
            if (!settings_[kGuardStart + i].is(guard[i])) return kGuardStart + i;
        }
        return kSettings;
    }

    // read_guard() reads the registers of consecutive settings. This is the index of the first of them.
    static constexpr size_t kGuardStart = 1;

  private:
    size_t guard_size() const { return has_accel_config_2_ ? kGuardBytes : kGuardBytes - 1; }

    I2cBus& bus_;
    RegisterSetting settings_[kSettings];
    bool has_accel_config_2_ = true;
};

// Converts the bytes of a burst to counts. The chip is big-endian (register map, sections 4.22 to 4.24).
inline void decode_burst(const uint8_t (&burst)[Mpu9250::kBurstBytes], Sample& sample) {
    int16_t* const fields[] = {&sample.accel_x, &sample.accel_y, &sample.accel_z, &sample.temperature,
                               &sample.gyro_x,  &sample.gyro_y,  &sample.gyro_z};
    for (size_t i = 0; i < 7; ++i) {
        *fields[i] = static_cast<int16_t>(static_cast<uint16_t>(burst[2 * i] << 8 | burst[2 * i + 1]));
    }
}

// Whether a value of the gyroscope is at an end of the range of counts, so that the true rate may be larger.
inline bool at_end_of_range(int16_t counts) { return counts == INT16_MAX || counts == INT16_MIN; }

inline bool gyro_saturated(const Sample& sample) {
    return at_end_of_range(sample.gyro_x) || at_end_of_range(sample.gyro_y) || at_end_of_range(sample.gyro_z);
}

}  // namespace fltea
