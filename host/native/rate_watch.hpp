// Checks whether the times of samples agree with the rate that their device states. A device numbers its
// sampling instants and adds its own time to each sample, so the numbers and times of samples together give
// the true rate. The rate that HELLO states is a constant of the firmware.
//
// A check of single samples is not enough. It has to accept time differences that are wrong by one period,
// because samples may come in bursts. If a device has half the stated rate, its samples are two of the stated
// periods apart. This is wrong by only one period, and would be accepted.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace fltea {

class RateWatch {
  public:
    // The stated rate says how long a number of samples should take (expected time). The rate counts as
    // different if the measured time differs from the expected time by more than the sum of two terms:
    // kTolerance times the expected time, and kPeriods sampling periods. The first term allows for sensor
    // clocks, which are accurate to 1 %, cheap ones to 5 %. The second allows for bursts of samples, which
    // can shift each end of the measured time by one period.
    static constexpr double kTolerance = 0.05, kPeriods = 2;
    // kLeastPairs: A verdict needs this number of consecutive pairs of neighbouring samples. The rates of
    // these pairs have to be similar. kWindow: After this number of sampling instants, the check restarts, so
    // that it uses only recent samples.
    static constexpr std::int64_t kLeastPairs = 20, kWindow = 200;
    // A step of the sample number that is larger than this is not used, because the number may have wrapped.
    static constexpr std::int64_t kLargestStep = 64;

    enum Verdict { kUnknown, kAgrees, kDiffers };

    void begin() { has_last_ = false; }

    // Adds a sample. `step`: its sequence number minus that of the previous sample. `step_us`: its device
    // time minus that of the previous sample [us]. Wraps are removed from both. `period_us`: sampling period
    // that HELLO states [us].
    Verdict add(std::int64_t step, std::int64_t step_us, double period_us) {
        const bool is_first = !has_last_;
        has_last_ = true;
        const bool is_usable = step >= 1 && step <= kLargestStep && step_us > 0;
        const bool is_alike = pairs_ == 0 || std::llabs(step_us * steps_ - us_ * step) * 2 <= us_ * step;
        // the check begins again after a restart or a stall of the device, or if its time stamps come in
        // bursts
        if (is_first || !is_usable || !is_alike) {
            pairs_ = steps_ = us_ = 0;
            return kUnknown;
        }
        ++pairs_;
        steps_ += step;
        us_ += step_us;
        if (pairs_ < kLeastPairs) return kUnknown;
        const double stated_us = double(steps_) * period_us;
        const bool differs =
            std::fabs(double(us_) - stated_us) > kTolerance * stated_us + kPeriods * period_us;
        if (differs) rate_hz_ = 1e6 * double(steps_) / double(us_);
        const bool is_full = steps_ >= kWindow;
        if (is_full) pairs_ = steps_ = us_ = 0;
        return differs ? kDiffers : is_full ? kAgrees : kUnknown;
    }

    // Rate of the samples by the device's clock, as it was measured when it last differed from the stated
    // rate.
    double rate_hz() const { return rate_hz_; }

  private:
    std::int64_t pairs_ = 0, steps_ = 0, us_ = 0;
    double rate_hz_ = 0;
    bool has_last_ = false;
};

}  // namespace fltea
