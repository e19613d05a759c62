// Where and when a sample was that follows on the one before it: the rules of host/fltea/stream/place.py and
// time.py for a sample with which no gap, epoch or second of the device's clock begins.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace fltea {

struct FollowRule {
    double period_us, tolerance_us;
    std::int64_t disagreement_ns, silence_ns;
};

// The newest sample: as it came, and its number and time in the epoch.
struct SamplePlace {
    std::int64_t sequence, device_us, host_ns, seq, epoch_us;

    // False, and nothing has changed, if this sample does not follow on.
    bool go_on(const FollowRule& rule, std::int64_t next_sequence, std::int64_t next_us,
               std::int64_t next_ns) {
        const std::int64_t step_us = (next_us - device_us) & 0xFFFFFFFF, step_ns = next_ns - host_ns;
        if (((next_sequence - sequence) & 0xFFFF) != 1 ||
            !(std::fabs(double(step_us) - rule.period_us) <= rule.tolerance_us) ||
            std::llabs(step_us * 1000 - step_ns) > rule.disagreement_ns || step_ns > rule.silence_ns)
            return false;
        sequence = next_sequence;
        device_us = next_us;
        host_ns = next_ns;
        ++seq;
        epoch_us += step_us;
        return true;
    }
};

// The device's clock in a second of its time; the line through the seconds before it is known.
struct SecondOfClock {
    std::int64_t origin_us, origin_ns, offset_ns, last_ns;
    double centre_s, centre_delay_s, slope;
    bool any;  // has come in this second; the earliest is known then
    double earliest_s, earliest_delay_s;

    // Unix time of a sample; it never runs backwards.
    std::int64_t time(std::int64_t epoch_us, std::int64_t host_ns) {
        const double device_s = double(epoch_us - origin_us) * 1e-6;
        const double delay_s = double(host_ns - origin_ns) * 1e-9 - device_s;
        if (!any || delay_s < earliest_delay_s) {
            any = true;
            earliest_s = device_s;
            earliest_delay_s = delay_s;
        }
        const double estimate_s = device_s + centre_delay_s + slope * (device_s - centre_s);
        const std::int64_t now_ns =
            origin_ns + offset_ns + static_cast<std::int64_t>(std::nearbyint(estimate_s * 1e9));
        last_ns = now_ns > last_ns ? now_ns : last_ns + 1;
        return last_ns;
    }
};

}  // namespace fltea
