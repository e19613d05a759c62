// Tests of fits of noise models: they have to end inside their bounds.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "whittle_rig.hpp"

TEST_CASE("noise models: a matrix is solved by its factor, and one that is not positive has none") {
    double a[kMostFree][kMostFree] = {{4, 2, 0}, {2, 5, 1}, {0, 1, 3}}, b[] = {1, -2, 3};
    double x[] = {1, -2, 3};
    double left[kMostFree][kMostFree];
    std::copy(&a[0][0], &a[0][0] + kMostFree * kMostFree, &left[0][0]);
    REQUIRE(factor(3, left));
    substitute(3, left, x, true);
    for (int i = 0; i < 3; ++i)
        CHECK(a[i][0] * x[0] + a[i][1] * x[1] + a[i][2] * x[2] == doctest::Approx(b[i]));
    a[1][1] = 1;
    CHECK_FALSE(factor(3, a));
}

TEST_CASE(
    "noise models: fits end inside their bounds from anywhere, for any number of bins, whatever the data") {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> anywhere(-60, 60);
    for (std::size_t size = 2; size < 20; ++size) {
        const Bins plain = bins_of(size);
        for (int kind = 0; kind < 4; ++kind) {
            Numbers power = drawn(plain, Numbers(size, 1.0), static_cast<unsigned>(size));
            for (std::size_t i = 0; i < size; ++i) {
                if (kind == 1 && i % 2) power[i] = 0;
                if (kind == 2)
                    power[i] *= std::pow(10.0, 30 * static_cast<double>(i) / static_cast<double>(size));
                if (kind == 3) power[i] = i ? 0 : 1e90;
            }
            const Bins bins = with_power(plain, power);
            for (const Row& row : kTable) {
                Example one(row.part, random);
                for (double& parameter : one.eta) parameter = anywhere(random);
                CAPTURE(size);
                CAPTURE(kind);
                CAPTURE(std::string(row.name));
                const double nll = score(bins, one.terms, one.eta.data(), -1, Patience());
                CHECK_FALSE(std::isnan(nll));
                const Bounds bounds(one.terms, bins, 1);
                for (int i = 0; i < free_of(one.terms); ++i) {
                    CHECK(one.eta[static_cast<std::size_t>(i)] >= bounds.low[i]);
                    CHECK(one.eta[static_cast<std::size_t>(i)] <= bounds.high[i]);
                }
            }
        }
    }
}

TEST_CASE("noise models: what is held keeps its value, and the others are the best there are with it") {
    const Bins plain = bins_of(60);
    const Terms terms = {{kWhite, 0}, {kRelaxation, 0}};
    const std::vector<double> truth = {0, 1, -3};
    const Bins bins = with_power(plain, spectrum(plain, terms, truth));
    std::vector<double> eta = {-1, 2, -2.5};
    const double held = score(bins, terms, eta.data(), 2, Patience());
    CHECK(eta[2] == -2.5);
    const double best = held;
    for (int i : {0, 1}) {
        for (double step : {-1e-3, 1e-3}) {
            std::vector<double> other = eta;
            other[static_cast<std::size_t>(i)] += step;
            CHECK(Spectrum(bins).at(terms, other.data()) >= best - 1e-6);
        }
    }
    std::vector<double> all = eta;
    CHECK(score(bins, terms, all.data(), -1, Patience()) < held - 1);
    for (std::size_t i = 0; i < 3; ++i) CHECK(all[i] == doctest::Approx(truth[i]).epsilon(0.01));
}
