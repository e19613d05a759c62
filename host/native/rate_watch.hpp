// Whether the times of samples agree with the rate that their device states. A device numbers its sampling
// instants and writes its own time into each, so number and time together are its rate; HELLO's is a constant
// of its firmware. Sample by sample the two may differ by a period, which lets half the rate pass.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace fltea {

class RateWatch {
  public:
    // Sensors' own clocks are within 1 %, cheap ones within 5 %; a burst shifts both ends by a period.
    static constexpr double kTolerance = 0.05, kPeriods = 2;
    // So many pairs of neighbours have to be alike before anything is said, and after so many steps it begins
    // again, so that the newest ones count.
    static constexpr std::int64_t kLeastPairs = 20, kWindow = 200;
    // A larger step of the number may be one that has wrapped.
    static constexpr std::int64_t kLargestStep = 64;

    enum Verdict { kUnknown, kAgrees, kDiffers };

    void begin() { has_last_ = false; }

    // step, step_us: of number and time since the sample before, without their wraps.
    Verdict add(std::int64_t step, std::int64_t step_us, double period_us) {
        const bool is_first = !has_last_;
        has_last_ = true;
        const bool is_usable = step >= 1 && step <= kLargestStep && step_us > 0;
        const bool is_alike = pairs_ == 0 || std::llabs(step_us * steps_ - us_ * step) * 2 <= us_ * step;
        if (is_first || !is_usable || !is_alike) {  // a restart, a stall, or stamps that come in bursts
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

    // By the device's clock, as of the last time that it differed.
    double rate_hz() const { return rate_hz_; }

  private:
    std::int64_t pairs_ = 0, steps_ = 0, us_ = 0;
    double rate_hz_ = 0;
    bool has_last_ = false;
};

}  // namespace fltea
