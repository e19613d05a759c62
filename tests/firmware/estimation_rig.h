// Helpers for the tests of the device's estimates without the rest of the device: samples by their sampling
// instants, the device's estimation, and the expected output for a single axis.
#pragma once
#include <doctest/doctest.h>

#include <vector>

#include "estimation.h"
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
    // the sampling instants from never_from to never_to - 1 are left out, as if they had never been
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

// Compares an ESTIMATE of the device (a) with the expected one (b). The flag `skipped` of a is ignored: it
// says that the queue of samples was full, and the expected results are made without a queue.
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
