// Fits a device's clock to the host's clock by a straight line through the earliest arrivals.
//
// The delay between sampling and arrival is never negative, but it is often large and comes in bursts,
// because of USB bridges and schedulers. Therefore each caller passes only the earliest arrival of each
// second or so, and a line through these is fitted by least squares. The slope of this line is the difference
// of the two clocks' rates.
//
// The callers: timebase.hpp (times of live samples and of recordings), sources/i2c/fifo_clock.py (a sensor
// without a time of its own), machine/doctor/hearing.py (difference of the clocks with its standard error).
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>

namespace fltea {

struct Arrival {
    double device, delay;  // time of a sample by the device's clock, and the delay until the sample arrived
};

struct ClockFit {
    // point with the mean time and the mean delay of all arrivals, through which the fitted line passes
    Arrival centre = {};
    double slope = 0;  // slope of the fitted line: change of the delay per unit of the device's time
    // Standard error of the slope, computed from the residuals; infinite with fewer than three arrivals.
    double slope_std = std::numeric_limits<double>::infinity();

    double at(double device) const { return centre.delay + slope * (device - centre.device); }
};

// Fits the line to `arrivals`, a container with at least one `Arrival`.
//
// `prior` says how well it is known before the fit that the slope is near 0: the standard deviation of a
// delay divided by that of the slope, in the device's unit of time. If nothing is known of the slope, `prior`
// is 0, and the arrivals must have at least two different device times.
template <typename Arrivals>
ClockFit fit_clock(const Arrivals& arrivals, double prior) {
    ClockFit fit;
    const double n = double(arrivals.size());
    for (const Arrival& one : arrivals) {
        fit.centre.device += one.device;
        fit.centre.delay += one.delay;
    }
    fit.centre = {fit.centre.device / n, fit.centre.delay / n};
    double xx = 0, xy = 0;
    for (const Arrival& one : arrivals) {
        const double x = one.device - fit.centre.device, y = one.delay - fit.centre.delay;
        xx += x * x;
        xy += x * y;
    }
    fit.slope = xy / (xx + prior * prior);
    return fit;
}

// Does the same as `fit_clock`, and also computes the standard error of the slope.
template <typename Arrivals>
ClockFit fit_clock_with_error(const Arrivals& arrivals, double prior) {
    ClockFit fit = fit_clock(arrivals, prior);
    if (arrivals.size() < 3) return fit;
    double xx = prior * prior, left = 0;
    for (const Arrival& one : arrivals) {
        const double x = one.device - fit.centre.device, off = one.delay - fit.at(one.device);
        xx += x * x;
        left += off * off;
    }
    fit.slope_std = std::sqrt(left / (double(arrivals.size()) - 2) / xx);
    return fit;
}

}  // namespace fltea
