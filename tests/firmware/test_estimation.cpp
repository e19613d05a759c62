// Tests of the device's estimates without the rest of the device: start-up window, order of work, queue and
// gaps.
#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "estimation.h"
#include "moments.h"
#include "mpu9250.h"

using fltea::AxisEstimator;
using fltea::Estimate;
using fltea::Estimation;
namespace flags = fltea::estimate_flags;
namespace settings = fltea::settings;

namespace {

constexpr uint32_t kStartup = settings::kStartup, kEvery = settings::kEstimateEvery;
constexpr uint32_t kMaxGap = settings::kMaxGap, kQueue = 32;
constexpr float kLsb = static_cast<float>(fltea::kGyroLsbTenths) / 10.0f;

// Returns the noise of an axis at a sampling instant. It depends only on axis and instant, so that a test can
// ask for the same noise again.
int16_t count_at(uint32_t instant, size_t axis) {
    const uint32_t mixed = (instant * 3 + static_cast<uint32_t>(axis)) * UINT32_C(2654435761);
    return static_cast<int16_t>(mixed >> 29) + static_cast<int16_t>(10 * axis);
}

fltea::Sample sample_at(uint32_t instant) {
    fltea::Sample sample = {};
    sample.gyro_x = count_at(instant, 0);
    sample.gyro_y = count_at(instant, 1);
    sample.gyro_z = count_at(instant, 2);
    return sample;
}

struct Device {
    Estimation estimation;
    std::vector<Estimate> made;

    Device() { estimation.begin(); }

    void add(uint32_t instant) { estimation.add(sample_at(instant), instant); }
    bool step() {
        Estimate message;
        const bool due = estimation.work(message);
        if (due) made.push_back(message);
        return due;
    }
    void work() {
        while (estimation.busy()) step();
    }
    void run(uint32_t from, uint32_t to) {
        for (uint32_t instant = from; instant != to; ++instant) {
            add(instant);
            work();
        }
    }
    // Runs the estimation, and keeps only the estimates that are produced in this run.
    void run_anew(uint32_t from, uint32_t to) {
        made.clear();
        run(from, to);
    }
    fltea::Estimator report() const {
        fltea::Estimator message;
        estimation.report(message);
        return message;
    }
};

// The expected output for a single axis of a device that begins at the sampling instant `first`. The device
// gets the samples of those instants for which `is_there` is true.
struct Alone {
    AxisEstimator estimator;
    size_t axis;
    uint32_t at, collected = 0;
    // the device knows of no sampling instants from never_from to never_to - 1
    uint32_t never_from = 0, never_to = 0;

    Alone(size_t axis, uint32_t first) : axis(axis), at(first) { estimator.begin(); }

    template <class IsThere>
    Estimate after(uint32_t instant, IsThere is_there) {
        for (; at != instant + 1; ++at) {
            if (at >= never_from && at < never_to) continue;
            const int16_t count = count_at(at, axis);
            if (collected == kStartup) {
                estimator.step(is_there(at) ? &count : nullptr);
            } else if (is_there(at)) {
                estimator.collect(count);
                if (++collected == kStartup) estimator.start();
            }
        }
        Estimate message = Estimate();
        estimator.report(message);
        return message;
    }
};

bool always(uint32_t) { return true; }

// Compares all fields of two ESTIMATEs, except the flag `skipped`, which depends on the queue.
void check_same(const Estimate& a, const Estimate& b) {
    CHECK((a.flags & ~flags::skipped) == b.flags);
    CHECK(a.alpha == b.alpha);
    CHECK(a.alpha_std == b.alpha_std);
    CHECK(a.f == b.f);
    CHECK(a.f_std == b.f_std);
    CHECK(a.state == b.state);
    CHECK(a.innovation == b.innovation);
    CHECK(a.state_bound == b.state_bound);
}

}  // namespace

TEST_CASE("estimation: the window takes its samples without a word, and age is 1 at the first after it") {
    Device device;
    CHECK(device.report().begun == 1);
    device.run(0, kStartup - 1);
    CHECK(device.report().remaining == 1);
    CHECK(device.report().bias_x == 0);
    CHECK(!device.estimation.started());
    device.run(kStartup - 1, kStartup);
    CHECK(device.estimation.started());
    CHECK(device.report().remaining == 0);
    CHECK(device.made.empty());

    device.add(kStartup);
    for (size_t axis = 0; axis < 3; ++axis) {
        REQUIRE(device.estimation.busy());
        REQUIRE(device.step());
        const Estimate& estimate = device.made.back();
        CHECK(static_cast<size_t>(estimate.axis) == axis);
        CHECK(estimate.age == 1);
        CHECK(estimate.sample == kStartup);
        CHECK(int(estimate.flags) == int(flags::valid));
    }
    CHECK(!device.estimation.busy());
}

TEST_CASE("estimation: bias and R are those of the window, in deg/s") {
    Device device;
    device.run(100, 100 + kStartup + 50);
    const fltea::Estimator report = device.report();
    const float bias[] = {report.bias_x, report.bias_y, report.bias_z};
    const float r[] = {report.r_x, report.r_y, report.r_z};
    for (size_t axis = 0; axis < 3; ++axis) {
        std::vector<int16_t> counts;
        for (uint32_t i = 0; i < kStartup; ++i) counts.push_back(count_at(100 + i, axis));
        const Moments expected = in_two_passes(counts);
        CHECK(static_cast<double>(bias[axis] * kLsb) == doctest::Approx(expected.mean).epsilon(3e-7));
        CHECK(static_cast<double>(r[axis] * kLsb * kLsb) == doctest::Approx(expected.variance).epsilon(5e-7));
    }
}

TEST_CASE(
    "estimation: an ESTIMATE of each axis at every tenth number, over their wrap, as of an axis alone") {
    const uint32_t first = 65536 - kStartup - 203;
    Device device;
    device.run(first, 65536 + 200);
    Alone alone[] = {{0, first}, {1, first}, {2, first}};
    size_t at = 0;
    for (uint32_t instant = first + kStartup; instant != 65536 + 200; ++instant) {
        if (instant % 65536 % kEvery != 0) continue;
        for (Alone& axis : alone) {
            REQUIRE(at < device.made.size());
            const Estimate& estimate = device.made[at++];
            CHECK(static_cast<size_t>(estimate.axis) == axis.axis);
            CHECK(estimate.sample == instant % 65536);
            CHECK(estimate.age == instant - first - kStartup + 1);
            check_same(estimate, axis.after(instant, always));
        }
    }
    CHECK(at == device.made.size());
}

TEST_CASE(
    "estimation: a gap is bridged by prediction up to the longest, which age counts; then all begins again") {
    for (uint32_t gap : {1u, 2u, 50u, kMaxGap, kMaxGap + 1, 3000u}) {
        CAPTURE(gap);
        Device device;
        const uint32_t lost = kStartup + 30, back = lost + gap, end = back + kStartup + 30;
        device.run(0, lost);
        const size_t before = device.made.size();
        device.run(back, end);
        const bool bridged = gap <= kMaxGap;
        CHECK(device.report().begun == (bridged ? 1 : 2));
        const uint32_t first = bridged ? 0 : back;
        Alone alone(2, first);
        uint32_t compared = 0;
        for (size_t i = before; i < device.made.size(); ++i) {
            const Estimate& estimate = device.made[i];
            CHECK(estimate.sample >= back);
            CHECK(estimate.age == estimate.sample - first - kStartup + 1);
            if (estimate.axis != fltea::Axis::gyro_z) continue;
            check_same(estimate,
                       alone.after(estimate.sample, [=](uint32_t at) { return at < lost || at >= back; }));
            ++compared;
        }
        CHECK(compared >= 3);
    }
}

TEST_CASE("estimation: samples lost within the window do not matter to it") {
    Device device;
    device.run(0, 100);
    device.run(100 + kMaxGap, kStartup + kMaxGap);
    CHECK(device.estimation.started());
    CHECK(device.report().begun == 1);
    device.run(kStartup + kMaxGap, kStartup + kMaxGap + 1);
    REQUIRE(device.made.size() == 3);
    CHECK(device.made[0].age == 1);
}

TEST_CASE(
    "estimation: what finds the queue full is skipped, counted, said, and has never been to the filters") {
    Device device;
    const uint32_t first = kStartup + 5, taken = first + kQueue, skipped = 7;
    device.run(0, first);
    for (uint32_t instant = first; instant != taken + skipped; ++instant) device.add(instant);
    CHECK(device.report().queue == kQueue);
    CHECK(device.report().skipped == skipped);
    device.made.clear();
    device.work();
    CHECK(device.report().queue == 0);
    device.run(taken + skipped, taken + 100);
    CHECK(device.report().skipped == skipped);
    CHECK(device.report().begun == 1);

    Alone alone(0, 0);
    alone.never_from = taken, alone.never_to = taken + skipped;
    REQUIRE(device.made.size() >= 30);
    for (const Estimate& estimate : device.made) {
        CHECK((estimate.flags & flags::skipped) != 0);
        CHECK(estimate.age == estimate.sample - kStartup + 1 - (estimate.sample < taken ? 0 : skipped));
        if (estimate.axis == fltea::Axis::gyro_x) check_same(estimate, alone.after(estimate.sample, always));
    }
    // A new start resets the state of the estimation, but not the count of skipped samples.
    device.estimation.begin();
    device.run_anew(taken + 100, taken + 100 + kStartup + kEvery);
    REQUIRE(device.made.size() == 3);
    CHECK(int(device.made[0].flags) == int(flags::valid));
    CHECK(device.report().skipped == skipped);
}

TEST_CASE("estimation: a queue that stays full for longer than the longest gap begins again") {
    Device device;
    device.run(0, kStartup + 5);
    uint32_t instant = kStartup + 5;
    for (uint32_t i = 0; i <= kQueue + kMaxGap; ++i) device.add(instant++);
    CHECK(device.report().begun == 1);
    device.add(instant++);
    CHECK(device.report().begun == 2);
    CHECK(device.report().skipped == kMaxGap + 1);
    CHECK(device.report().queue == 1);
    CHECK(device.report().remaining == kStartup);
}

TEST_CASE("estimation: begin() leaves nothing of what was under way") {
    for (int steps = 0; steps < 5; ++steps) {
        CAPTURE(steps);
        Device device;
        device.run(0, kStartup + 20);
        // begin() is called at the worst time: some axes have been processed across a gap, other axes have
        // not, and more samples wait in the queue.
        for (uint32_t instant : {kStartup + 25, kStartup + 26, kStartup + 27}) device.add(instant);
        for (int i = 0; i < steps; ++i) device.step();
        device.estimation.begin();
        CHECK(!device.estimation.busy());
        CHECK(!device.estimation.started());
        CHECK(device.report().begun == 2);
        CHECK(device.report().bias_z == 0);
        CHECK(device.report().r_z == 0);
        const uint32_t first = 7000;
        device.run_anew(first, first + kStartup + 1);
        REQUIRE(device.made.size() == 3);
        for (size_t axis = 0; axis < 3; ++axis) {
            CHECK(static_cast<size_t>(device.made[axis].axis) == axis);
            CHECK(device.made[axis].age == 1);
            check_same(device.made[axis], Alone(axis, first).after(first + kStartup, always));
        }
    }
}

TEST_CASE("estimation: an axis that does not change in the window is said to be constant, the others work") {
    for (size_t constant = 0; constant < 3; ++constant) {
        Estimation estimation;
        estimation.begin();
        std::vector<Estimate> made;
        for (uint32_t instant = 0; instant < kStartup + 1; ++instant) {
            fltea::Sample sample = sample_at(instant);
            int16_t* const axes[] = {&sample.gyro_x, &sample.gyro_y, &sample.gyro_z};
            *axes[constant] = 33;
            estimation.add(sample, instant);
            Estimate message;
            while (estimation.busy()) {
                if (estimation.work(message)) made.push_back(message);
            }
        }
        REQUIRE(made.size() == 3);
        for (size_t axis = 0; axis < 3; ++axis) {
            CHECK(int(made[axis].flags) == int(axis == constant ? flags::constant : flags::valid));
            CHECK((made[axis].alpha == 0) == (axis == constant));
        }
        fltea::Estimator report;
        estimation.report(report);
        const float bias[] = {report.bias_x, report.bias_y, report.bias_z};
        const float r[] = {report.r_x, report.r_y, report.r_z};
        CHECK(bias[constant] == 33 / kLsb);
        for (size_t axis = 0; axis < 3; ++axis) CHECK((r[axis] == 0) == (axis == constant));
    }
}

TEST_CASE("estimation: ESTIMATOR says what it works with") {
    const fltea::Estimator report = Device().report();
    CHECK(report.variant == settings::kVariant);
    CHECK(report.guard == settings::kGuard);
    CHECK(report.startup == kStartup);
    CHECK(report.max_gap == kMaxGap);
    CHECK(report.every == kEvery);
    CHECK(report.state_p0 == settings::kStateP0);
    CHECK(report.state_q == settings::kStateQ);
    CHECK(report.alpha0 == settings::kJointAlpha0);
    CHECK(report.parameter0 == settings::kJointBeta0);
    CHECK(report.alpha_p0 == settings::kJointP0);
    CHECK(report.parameter_p0 == settings::kJointP0);
    CHECK(report.gate == settings::kGate);
}

using Verdict = fltea::FitVerdict;

static fltea::Fit fit_of_y(Verdict verdict, float s2, float r,
                           uint8_t which = fltea::fit_flags::alpha_defined) {
    fltea::Fit fit = {};
    fit.axis = fltea::Axis::gyro_y;
    fit.verdict = verdict;
    fit.flags = which;
    fit.s2 = s2;
    fit.r = r;
    return fit;
}

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

TEST_CASE("estimation: a gap of any length is too long, and numbers of instants wrap after 497 days") {
    for (uint32_t gap : {kMaxGap + 1, 0x10000u + 1, 0x10000u + kMaxGap, 0x80000000u, 0xFFFFFFF0u}) {
        CAPTURE(gap);
        Device device;
        device.run(100, 120);
        CHECK(device.estimation.add(sample_at(119 + gap), 120 + gap));
    }
    Device device;
    const uint32_t begin = 0u - kStartup - 500;
    device.run(begin, 1000);
    CHECK(device.report().begun == 1);
    REQUIRE(device.made.size() == 1500 / kEvery * 3);
    for (size_t i = 0; i < device.made.size(); ++i) {
        const Estimate& made = device.made[i];
        CHECK(made.sample == static_cast<uint16_t>(begin + kStartup + made.age - 1));
        CHECK(made.sample % kEvery == 0);
        const uint32_t apart = made.sample == 0 ? 65536 % kEvery : kEvery;
        if (i >= 3) CHECK(made.age - device.made[i - 3].age == apart);
    }
}
