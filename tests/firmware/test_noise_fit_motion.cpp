// Tests of motion of the sensor: motion of one axis stops all axes of the device from learning.
#include "noise_fit_rig.h"

namespace {

// Three axes, one of which can rotate.
struct Turning {
    std::unique_ptr<NoiseFit> fit{new NoiseFit};
    std::vector<Counts> noise;

    Turning() {
        fit->begin();
        for (unsigned i = 0; i < 3; ++i) {
            noise.emplace_back(i + 1, 0.2);
            fit->start(i);
        }
    }
    // Adds n samples to each axis. `fits`: whether there is time for fits. `leaks`: rate that is added on all
    // axes [counts]. `turn`: rate that is added on `axis` alone [counts].
    void add(int n, bool fits, int leaks = 0, size_t axis = 0, int turn = 0) {
        for (int k = 0; k < n; ++k) {
            for (size_t i = 0; i < 3; ++i) {
                fit->add(i, static_cast<int16_t>(noise[i]() + leaks + (i == axis ? turn : 0)));
                while (fit->passing()) fit->pass();
            }
            while (fits && fit->busy()) {
                Fit message = {};
                Spectrum spectrum = {};
                fit->work(message, spectrum);
            }
        }
    }
    fltea::Estimate tracked(size_t i) {
        fltea::Estimate message = {};
        fit->track(i, message);
        return message;
    }
};

}  // namespace

TEST_CASE("noise fit: while one axis turns none learns, whether fits go on or not") {
    for (const bool fits : {false, true}) {
        for (size_t axis = 0; axis < 3; ++axis) {
            Turning turning, resting;
            for (Turning* one : {&turning, &resting}) one->add(6400, true);
            turning.add(3200, fits, 3, axis, 400);
            resting.add(3200, fits);
            for (size_t i = 0; i < 3; ++i) {
                CAPTURE(axis);
                CAPTURE(i);
                const fltea::Estimate held = turning.tracked(i), known = resting.tracked(i);
                // While one axis turned, all axes measured three counts more (`leaks`). No axis has taken
                // this for bias.
                CHECK(std::fabs(held.tracker_bias) * kCountsPerDps < 1.0f);
                CHECK(held.tracker_bias_std > known.tracker_bias_std);
            }
            turning.add(200, fits);
            resting.add(200, fits);
            for (size_t i = 0; i < 3; ++i) {
                const fltea::Estimate back = turning.tracked(i), known = resting.tracked(i);
                CHECK(std::fabs(back.tracker_bias - known.tracker_bias) < 2 * known.tracker_bias_std);
            }
        }
    }
}

TEST_CASE("noise fit: when it begins again nothing is known of motion") {
    Turning again, fresh;
    again.add(1600, true);
    again.add(300, true, 0, 1, 4000);
    again.fit->begin();
    for (unsigned i = 0; i < 3; ++i) again.fit->start(i);
    again.noise = fresh.noise;
    for (Turning* one : {&again, &fresh}) one->add(1500, true);
    for (size_t i = 0; i < 3; ++i) {
        CHECK(again.tracked(i).tracker_bias == fresh.tracked(i).tracker_bias);
        CHECK(again.tracked(i).tracker_bias_std == fresh.tracked(i).tracker_bias_std);
    }
}

TEST_CASE("noise fit: an axis that is not started does not hold up the others") {
    Turning turning;
    turning.fit->begin();
    turning.fit->start(0);
    turning.fit->start(1);
    turning.add(3200, true);
    turning.add(640, true, 0, 1, 400);
    CHECK(std::fabs(turning.tracked(1).tracker_bias) * kCountsPerDps < 1.0f);
    CHECK((turning.tracked(2).flags & fltea::estimate_flags::tracked) == 0);
}
