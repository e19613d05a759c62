// Registers of the MPU-9250 that the driver uses. "Register map" stands for RM-MPU-9250A-00. The MPU-6050
// (RM-MPU-6000A-00) has all of them except ACCEL_CONFIG_2.
#pragma once

#include <stdint.h>

namespace fltea {
namespace mpu9250_reg {

constexpr uint8_t kSmplrtDiv = 0x19;     // register map, 4.4: output rate = internal rate / (1 + value)
constexpr uint8_t kConfig = 0x1A;        // register map, 4.5: bandwidth of the gyroscope (DLPF_CFG)
constexpr uint8_t kGyroConfig = 0x1B;    // register map, 4.6: range; filter on or off (FCHOICE_B)
constexpr uint8_t kAccelConfig = 0x1C;   // register map, 4.7: range
constexpr uint8_t kAccelConfig2 = 0x1D;  // register map, 4.8: bandwidth, filter on or off
constexpr uint8_t kIntPinCfg = 0x37;     // register map, 4.19: behaviour of the INT pin
constexpr uint8_t kIntEnable = 0x38;     // register map, 4.20: which events pulse the INT pin
constexpr uint8_t kAccelXoutH = 0x3B;    // register map, 4.22-4.24: 14 bytes: acceleration, temperature, rate
constexpr uint8_t kPwrMgmt1 = 0x6B;      // register map, 4.34: reset, sleep, clock
constexpr uint8_t kWhoAmI = 0x75;        // register map, 4.38: kind of chip

constexpr uint8_t kReset = 0x80;      // PWR_MGMT_1: H_RESET
constexpr uint8_t kPllClock = 0x01;   // PWR_MGMT_1: awake; the clock is the PLL as soon as it is ready
constexpr uint8_t kRawReady = 0x01;   // INT_ENABLE: RAW_RDY_EN
constexpr uint8_t kPulseHigh = 0x00;  // INT_PIN_CFG: push-pull, active high, a pulse of 50 us

// FS_SEL and ACCEL_FS_SEL are bits 4:3. The bits below them are FCHOICE_B, which must be 0 so that the
// filters are on.
constexpr uint8_t kRangeShift = 3;

}  // namespace mpu9250_reg
}  // namespace fltea
