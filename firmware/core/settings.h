// Everything that an owner may want to change, in one place; HELLO reports it to the host.
#pragma once

#include <stdint.h>

#include "filter_settings.h"
#include "messages.h"

// Set by the build to compile the other mode: -DFLTEA_SAMPLING_MODE=data_ready
#ifndef FLTEA_SAMPLING_MODE
#define FLTEA_SAMPLING_MODE timer
#endif
// The same for the estimator: -DFLTEA_ESTIMATE=false (and -DFLTEA_VARIANT=triple, filter_settings.h)
#ifndef FLTEA_ESTIMATE
#define FLTEA_ESTIMATE true
#endif

namespace fltea {
namespace settings {

// timer: four wires, the device's clock rules. data_ready: a fifth wire from the sensor's INT pin, the
// sensor's clock (±1 %) rules, and each time stamp is that of the sensor's own conversion.
constexpr SamplingMode kSamplingMode = SamplingMode::FLTEA_SAMPLING_MODE;

// Time between sampling instants [us]; whole milliseconds, the sensor's internal step.
constexpr uint32_t kSamplePeriodUs = 10000;

// Full scale, plus and minus [deg/s]: 250, 500, 1000 or 2000.
constexpr uint16_t kGyroRangeDps = 2000;

// Full scale, plus and minus [g]: 2, 4, 8 or 16.
constexpr uint16_t kAccelRangeG = 2;

// Bandwidth of the sensor's low-pass filters [Hz]: 184, 92, 41, 20, 10 or 5. The noise is the signal here,
// and a narrow filter colours it: 0.01 deg/s/sqrt(Hz) over 184 Hz gives about 0.02 (deg/s)^2, over 41 Hz
// about 0.005.
constexpr uint16_t kDlpfHz = 184;

// AD0 to ground: 0x68; AD0 to 3.3 V: 0x69.
constexpr uint8_t kSensorAddress = 0x68;
constexpr uint32_t kI2cHz = 400000;
// The longest a transfer may take before the bus counts as held [us]; the longest one needs 0.5 ms.
constexpr uint32_t kI2cTimeoutUs = 3000;

// Whether the device estimates by itself; ESTIMATOR reports to the host with what. Variant, guard, start-up
// window and the filters' numbers are those of `fltea run`: filter_settings.h.
constexpr bool kEstimate = FLTEA_ESTIMATE;
// ESTIMATEs belong to samples whose sequence is a multiple of this; at 2 the line is two thirds full.
constexpr uint16_t kEstimateEvery = 10;

// To the host [baud]: exact on the Due (84 MHz / 16 / 21) and on its USB chip; the usual 115200 is not.
constexpr uint32_t kLineBaud = kBaud;

}  // namespace settings
}  // namespace fltea
