// Relates the device's clock to the host's clock within one epoch (a run of samples without a restart or a
// long gap). The fit of the clocks over the last ten minutes (clock_fit.hpp) gives the host time of any
// sample without jitter.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>

#include "clock_fit.hpp"

namespace fltea {

class Timebase {
  public:
    // `offset_ns`: Unix time minus the time of the host's monotonic clock. The offset stays fixed for the
    // epoch (a run of samples without a restart or a long gap), so that a step of the system's clock causes
    // no jump in the time stamps.
    explicit Timebase(std::int64_t offset_ns = 0) : offset_ns_(offset_ns) {}

    // Adds the arrival of a sample, and returns the sample's Unix time [ns]. The returned times never run
    // backwards. If the newest fit of the clocks gives a time before that of the previous sample, the
    // returned time is one nanosecond after that of the previous sample.
    std::int64_t add(std::int64_t seq, std::int64_t device_us, std::int64_t host_ns) {
        if (!begun_) begin(seq, device_us, host_ns);
        if (device_us >= second_end_us_) {
            close_second();
            second_end_us_ = device_us + kSecondUs;
        }
        latest_seq_ = seq;
        latest_us_ = device_us;
        const double device_s = double(device_us - origin_us_) * 1e-6;
        const double delay_s = double(host_ns - origin_ns_) * 1e-9 - device_s;
        if (!any_ || delay_s < earliest_.delay) earliest_ = {device_s, delay_s};
        any_ = true;
        // In the first second there is no fit of the clocks yet. Each arrival with a shorter delay than all
        // earlier arrivals shifts the times of the samples after it.
        const double estimate_s =
            seconds_.empty() ? device_s + earliest_.delay
                             : device_s + fit_.centre.delay + fit_.slope * (device_s - fit_.centre.device);
        const std::int64_t now_ns =
            origin_ns_ + offset_ns_ + static_cast<std::int64_t>(std::nearbyint(estimate_s * 1e9));
        last_ns_ = now_ns > last_ns_ ? now_ns : last_ns_ + 1;
        return last_ns_;
    }

    // Returns how much faster the device's clock runs than the host's, in millionths. The result is NaN in
    // the first ten seconds. It is also NaN if all delays are exactly 0, because then the arrival times were
    // computed from the device times, and if the samples do not arrive in real time.
    double clock_ppm() const {
        bool any = false;
        for (const Arrival& one : seconds_) any |= one.delay != 0;
        if (seconds_.size() < kSecondsForPpm || !any || !is_real_time()) return kUnknown;
        return (1.0 / (1.0 + fit_.slope) - 1.0) * 1e6;
    }

    // Returns the number of samples per second of host time. The result is NaN before the second sample, and
    // if the samples do not arrive in real time.
    double rate_hz() const {
        if (!begun_ || latest_us_ == origin_us_ || !is_real_time()) return kUnknown;
        return double(latest_seq_ - first_seq_) / (double(latest_us_ - origin_us_) * 1e-6) /
               (1.0 + fit_.slope);
    }

  private:
    static constexpr std::int64_t kSecondUs = 1'000'000;
    static constexpr std::size_t kSecondsKept = 600, kSecondsForPpm = 10;
    static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    // Standard deviations that are assumed before any measurement: of a delay, and of the ratio of the two
    // clocks' rates. A sensor's own oscillator is accurate to 1 %.
    static constexpr double kDelayStdS = 1e-3, kClockStd = 1e-2;

    // The least time of the host in which a device's clock advances by one second, if the samples arrive in
    // real time [s]. No device's clock is twice as fast as it should be, but a stored file is read in an
    // instant. There is no upper limit, since an emulated device on a busy computer is slow.
    static constexpr double kLeastHostTime = 0.5;

    bool is_real_time() const { return 1.0 + fit_.slope >= kLeastHostTime; }

    void begin(std::int64_t seq, std::int64_t device_us, std::int64_t host_ns) {
        begun_ = true;
        first_seq_ = seq;
        origin_us_ = device_us;
        origin_ns_ = host_ns;
        second_end_us_ = device_us + kSecondUs;
    }

    void close_second() {
        if (!any_) return;
        if (seconds_.size() == kSecondsKept) seconds_.pop_front();
        seconds_.push_back(earliest_);
        any_ = false;
        fit_ = fit_clock(seconds_, kDelayStdS / kClockStd);
    }

    std::int64_t offset_ns_, first_seq_ = 0, latest_seq_ = 0, latest_us_ = 0;
    std::int64_t origin_us_ = 0, origin_ns_ = 0, second_end_us_ = 0;
    std::int64_t last_ns_ = std::numeric_limits<std::int64_t>::min();
    std::deque<Arrival> seconds_;  // earliest arrival of each finished second
    Arrival earliest_ = {};        // earliest arrival of the second in progress; its times are in s
    ClockFit fit_;
    bool begun_ = false, any_ = false;
};

}  // namespace fltea
