// All settings that the owner of a board may want to change. HELLO reports them to the host.
#pragma once

#include <stdint.h>

#include "filter_settings.h"
#include "messages.h"

// The sampling mode is `timer`. To compile the other mode, build with -DFLTEA_SAMPLING_MODE=data_ready.
#ifndef FLTEA_SAMPLING_MODE
#define FLTEA_SAMPLING_MODE timer
#endif
// To compile without the estimator, build with -DFLTEA_ESTIMATE=false. To compile another variant of the
// estimator (filter_settings.h), build with -DFLTEA_VARIANT=triple.
#ifndef FLTEA_ESTIMATE
#define FLTEA_ESTIMATE true
#endif

// To change samples per second, bandwidth and full scale, build with -DFLTEA_RATE_HZ=200 -DFLTEA_DLPF_HZ=92
// -DFLTEA_GYRO_RANGE_DPS=250 -DFLTEA_ACCEL_RANGE_G=4
#ifndef FLTEA_RATE_HZ
#define FLTEA_RATE_HZ 100
#endif
#ifndef FLTEA_DLPF_HZ
#define FLTEA_DLPF_HZ 184
#endif
#ifndef FLTEA_GYRO_RANGE_DPS
#define FLTEA_GYRO_RANGE_DPS 2000
#endif
#ifndef FLTEA_ACCEL_RANGE_G
#define FLTEA_ACCEL_RANGE_G 2
#endif
// To change the baud rate of the serial port, build with -DFLTEA_BAUD=400000, and give `fltea run --baud` the
// same number.
#ifndef FLTEA_BAUD
#define FLTEA_BAUD kBaud
#endif

namespace fltea {
namespace settings {

// What determines the sampling instants. With `timer`, it is the device's clock, and four wires suffice. With
// `data_ready`, it is the sensor's clock (±1 %), and a fifth wire from the sensor's INT pin is needed. Each
// time stamp is then that of the sensor's own conversion.
constexpr SamplingMode kSamplingMode = SamplingMode::FLTEA_SAMPLING_MODE;

// Time between sampling instants [us]. It is a whole number of milliseconds, because the sensor's internal
// period is 1 ms. At kBaud the serial port has room for 500 Hz; 1000 Hz needs 400,000 baud and no estimates.
// Above 100 Hz prefer data_ready: in timer mode a sample is up to 1 ms old.
constexpr uint32_t kSamplePeriodUs = 1000000 / FLTEA_RATE_HZ;
static_assert(kSamplePeriodUs * FLTEA_RATE_HZ == 1000000,
              "FLTEA_RATE_HZ must divide a second without a rest");

// Full scale of the gyroscope, ± 250, 500, 1000 or 2000 [deg/s].
constexpr uint16_t kGyroRangeDps = FLTEA_GYRO_RANGE_DPS;

// Full scale of the accelerometer, ± 2, 4, 8 or 16 [g].
constexpr uint16_t kAccelRangeG = FLTEA_ACCEL_RANGE_G;

// Bandwidth of the sensor's low-pass filters [Hz]: 184, 92, 41, 20, 10 or 5. The noise is the signal here,
// and a narrow filter colours it. Noise of 0.01 deg/s/sqrt(Hz) has a variance of about 0.02 (deg/s)^2 at 184
// Hz, and about 0.005 (deg/s)^2 at 41 Hz.
constexpr uint16_t kDlpfHz = FLTEA_DLPF_HZ;

// I2C address of the sensor: 0x68 if its pin AD0 is at ground, 0x69 if AD0 is at 3.3 V.
constexpr uint8_t kSensorAddress = 0x68;
constexpr uint32_t kI2cHz = 400000;
// If a transfer on the I2C bus takes longer than this time [us], a chip is taken to be holding the bus. The
// longest transfer needs 0.5 ms.
constexpr uint32_t kI2cTimeoutUs = 3000;

// Whether the device computes estimates itself. The frame ESTIMATOR reports their settings to the host.
// Variant, guard, start-up window and the numbers of the filters are the same as those of `fltea run`
// (filter_settings.h).
constexpr bool kEstimate = FLTEA_ESTIMATE;
// ESTIMATE frames are sent for each sample whose sequence number is a multiple of kEstimateEvery. From 20 Hz
// on, this gives about ten estimates a second. With frames for every second sample, the serial port would be
// two thirds full at 100 Hz.
constexpr uint16_t kEstimateEvery = FLTEA_RATE_HZ < 20 ? 1 : FLTEA_RATE_HZ / 10;

// Whether the device also fits the noise by maximum likelihood. One slice of a fit must not take longer than
// half a sampling period.
#ifndef FLTEA_FIT
#define FLTEA_FIT (FLTEA_ESTIMATE && FLTEA_RATE_HZ <= 200)
#endif
constexpr bool kFit = FLTEA_FIT;
static_assert(!kFit || (kEstimate && kSamplePeriodUs >= 5000),
              "fits need the estimates' queue, and at most 200 samples a second");
// Whether the board's filters take their variances Q (of a step of the state) and R (of the white noise) from
// each fit that rejects white noise and determines the order. -DFLTEA_TUNED=true switches this on. The host's
// filters do not follow these changes, so the host does not compare its estimates with the board's then.
#ifndef FLTEA_TUNED
#define FLTEA_TUNED false
#endif
constexpr bool kTuned = FLTEA_TUNED;
static_assert(!kTuned || kFit, "only a fit tells what to tune to");
// Number of samples from the beginning of one round of fits (one fit per axis) to the next round. It is the
// number of samples in 3 s.
constexpr uint16_t kFitEvery = 3 * FLTEA_RATE_HZ;
// The first of every kSpectrumEvery fits of an axis is sent with the bins of the spectrum that was fitted.
constexpr uint16_t kSpectrumEvery = 10;
// Percentage of the processor time that the fits may use. At 100 Hz, the fits and the rest of the program
// then use a quarter of the processor. Most rounds of fits need 4 to 6 % of the three seconds until the next
// round is due. A round that searches on a grid needs more, so it takes longer than three seconds.
constexpr uint32_t kFitShare = 6;

// Baud rate of the serial port. 250,000 baud is exact on the Due (84 MHz / 16 / 21) and on its USB chip, and
// the usual 115,200 baud is not. 400,000 baud is exact on the USB chip, and 1 % too fast on the Due (84 MHz /
// 16 / 13).
constexpr uint32_t kLineBaud = FLTEA_BAUD;

}  // namespace settings
}  // namespace fltea
