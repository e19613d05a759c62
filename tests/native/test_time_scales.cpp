// Tests of TimeScales. Its running sums say how much the mean of 1, 2, 4 … values differs from the mean of
// equally many values before. These variances are compared with their definition.
#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "noise.h"
#include "time_scales.hpp"

using fltea::TimeScales;

namespace {

typedef TimeScales<6> Scales;

// Compares the variance at each scale s with its definition. It is 2^s / 2 times the mean square of the
// difference between the means of two neighbouring groups of 2^s figures.
void check(const Scales& scales, const std::vector<float>& figures) {
    for (int s = 0; s < Scales::size(); ++s) {
        const std::size_t run = std::size_t(1) << s, pairs = figures.size() / (2 * run);
        double sum = 0;
        for (std::size_t i = 0; i < pairs; ++i) {
            double apart = 0;
            for (std::size_t k = 0; k < run; ++k) {
                apart += double(figures[2 * run * i + run + k]) - double(figures[2 * run * i + k]);
            }
            sum += apart * apart / double(run) / 2;
        }
        CHECK(scales.pairs(s) == double(pairs));
        if (pairs > 0) CHECK(scales.variance(s) == doctest::Approx(sum / double(pairs)).epsilon(1e-5));
    }
}

std::vector<float> noise(std::size_t n, unsigned long long seed) {
    Noise next(seed);
    std::vector<float> figures(n);
    for (float& one : figures) one = float(next());
    return figures;
}

}  // namespace

TEST_CASE("time scales: variances are those of the definition") {
    for (const std::size_t n : {0u, 1u, 2u, 3u, 64u, 1000u}) {
        const std::vector<float> figures = noise(n, n);
        Scales scales;
        for (const float one : figures) scales.add(one);
        check(scales, figures);
    }
}

TEST_CASE("time scales: of two stretches that end between pairs none is lost") {
    const std::vector<float> figures = noise(256, 7);
    Scales whole, first, second;
    for (std::size_t i = 0; i < figures.size(); ++i) {
        whole.add(figures[i]);
        (i < 160 ? first : second).add(figures[i]);
    }
    first.merge(second);
    for (int s = 0; s < Scales::size(); ++s) CHECK(first.pairs(s) == whole.pairs(s));
}

TEST_CASE("time scales: what is older than two spans is forgotten") {
    Scales scales(128);
    for (int i = 0; i < 1000; ++i) scales.add(i % 2 != 0 ? 1.0f : -1.0f);
    CHECK(scales.variance(0) == doctest::Approx(2));
    for (int i = 0; i < 2 * 128 + 2; ++i) scales.add(0);
    CHECK(scales.pairs(0) <= 128);
    CHECK(scales.variance(0) == 0);
}
