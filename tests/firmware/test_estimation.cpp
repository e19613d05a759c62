// Tests of the device's estimates without the rest of the device: start-up window, order of work, queue and
// gaps.
#include <doctest/doctest.h>

#include <vector>

#include "estimation_rig.h"
#include "moments.h"

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
        // begin() is called after `steps` steps of work. Some axes have then been processed across the gap,
        // other axes have not, and more samples wait in the queue.
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
