// Everything that an owner may want to change, in one place; HELLO reports it to the host.
#pragma once

#include <stdint.h>

#include "messages.h"

// Set by the build to compile the other mode: -DFLTEA_SAMPLING_MODE=data_ready
#ifndef FLTEA_SAMPLING_MODE
#define FLTEA_SAMPLING_MODE timer
#endif
// The same for the estimator: -DFLTEA_ESTIMATE=false, -DFLTEA_VARIANT=triple
#ifndef FLTEA_ESTIMATE
#define FLTEA_ESTIMATE true
#endif
#ifndef FLTEA_VARIANT
#define FLTEA_VARIANT joint
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

// Whether the device estimates by itself; ESTIMATOR reports all that follows up to the host. The values are
// those of `fltea run` (host/README.md), but for its window: the device's memory has no end.
constexpr bool kEstimate = FLTEA_ESTIMATE;
// joint: one filter on the order and h^alpha f. triple: three filters, as published.
constexpr EstimatorVariant kVariant = EstimatorVariant::FLTEA_VARIANT;
// Not off: only within a guard's bounds is the memory of use.
constexpr EstimatorGuard kGuard = EstimatorGuard::consistent;
// ESTIMATEs belong to samples whose sequence is a multiple of this; at 2 the line is two thirds full.
constexpr uint16_t kEstimateEvery = 10;
// Samples at rest that bias and R are drawn from.
constexpr uint16_t kStartup = 500;
// Longest gap that is bridged by prediction [samples].
constexpr uint16_t kMaxGap = 100;
// KFx: initial variance [(deg/s)^2], variance of a step, initial state [deg/s].
constexpr float kStateP0 = 0.01f, kStateQ = 0.15f, kStateX0 = 0.0f;
// The joint filter: order and beta = h^alpha f at the start, and variances of both.
constexpr float kJointAlpha0 = 0.5f, kJointBeta0 = -0.1f, kJointP0 = 0.06f, kJointQ0 = 0.0f,
                kJointDelta = 0.0f;
// KFo and KFw of the triple one; the latter's in s^-alpha.
constexpr float kOrderAlpha0 = 1.0f, kOrderP0 = 0.01f, kOrderQ0 = 0.1f, kOrderDelta = 0.5f;
constexpr float kParameterF0 = 0.0f, kParameterP0 = 0.01f, kParameterQ0 = 0.1f, kParameterDelta = 0.5f;
// Standard deviations from which on the guard softens an innovation.
constexpr float kGate = 10.0f;

// To the host [baud]: exact on the Due (84 MHz / 16 / 21) and on its USB chip; the usual 115200 is not.
constexpr uint32_t kLineBaud = kBaud;

}  // namespace settings
}  // namespace fltea
