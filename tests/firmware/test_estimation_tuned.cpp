// Tests of fits that tune the filters of the device's estimates.
#include <doctest/doctest.h>

#include <cmath>

#include "estimation_rig.h"

using Verdict = fltea::FitVerdict;

namespace {

fltea::Fit fit_of_y(Verdict verdict, float s2, float r, uint8_t which = fltea::fit_flags::alpha_defined) {
    fltea::Fit fit = {};
    fit.axis = fltea::Axis::gyro_y;
    fit.verdict = verdict;
    fit.flags = which;
    fit.s2 = s2;
    fit.r = r;
    return fit;
}

}  // namespace

TEST_CASE("estimation: a fit that rejects white noise tunes the filters of its axis, and of no other") {
    Device device;
    device.run(0, kStartup + 40);
    CHECK(!device.estimation.retune(fit_of_y(Verdict::white, 0.002f, 0.07f)));
    CHECK(!device.estimation.retune(fit_of_y(Verdict::fractional, 0.002f, 0.07f, 0)));
    const fltea::Fit fit = fit_of_y(Verdict::fractional, 0.002f, 0.07f);
    Alone untuned(1, 0), tuned(1, 0);
    untuned.after(kStartup + 39, always);
    tuned.after(kStartup + 39, always);
    CHECK(device.estimation.retune(fit));
    tuned.estimator.retune(fit.s2, fit.r);
    device.run_anew(kStartup + 40, kStartup + 200);
    size_t compared = 0;
    for (const Estimate& made : device.made) {
        CHECK(((made.flags & flags::tuned) != 0) == (made.axis == fltea::Axis::gyro_y));
        if (made.axis != fltea::Axis::gyro_y) continue;
        const Estimate expected = tuned.after(made.sample, always);
        CHECK(made.alpha == expected.alpha);
        CHECK(made.f == expected.f);
        CHECK(made.alpha != untuned.after(made.sample, always).alpha);
        ++compared;
    }
    CHECK(compared > 10);
    CHECK(device.report().r_y == fit.r);
    CHECK(device.report().r_x != fit.r);
    // After the sensor was set up again, the fit from before the set-up is not used any more.
    device.estimation.begin();
    device.run_anew(1000, 1000 + kStartup + 20);
    REQUIRE(!device.made.empty());
    for (const Estimate& made : device.made) CHECK((made.flags & flags::tuned) == 0);
}

TEST_CASE("estimation: variances that none can be tune nothing") {
    Device device;
    device.run(0, kStartup + 10);
    device.estimation.retune(fit_of_y(Verdict::relaxation, 0, 1));
    device.estimation.retune(fit_of_y(Verdict::relaxation, 1, NAN));
    device.run_anew(kStartup + 10, kStartup + 30);
    for (const Estimate& made : device.made) CHECK((made.flags & flags::tuned) == 0);
}
