// Whittle fits on data of all sizes: the logarithm, slopes against differences, and searches that end.
#include <doctest/doctest.h>

#include <random>

#include "pack_log.hpp"
#include "whittle_profile.hpp"

namespace {

using namespace fltea::whittle;

const Hold kScaledHolds[] = {kHoldOrder, kHoldFeedback, kHoldParameter, kHoldWeight};

// Exponential ordinates about 1 + 1/λ at frequencies up to π.
struct Example {
    std::vector<double> lam, counts, power;

    Example(std::size_t bins, std::size_t series, unsigned seed) {
        std::mt19937 random(seed);
        std::exponential_distribution<double> ordinate(1);
        for (std::size_t i = 0; i < bins; ++i) {
            lam.push_back(3.1415 * static_cast<double>(i + 1) / static_cast<double>(bins));
            counts.push_back(static_cast<double>(i % 3));
        }
        counts[0] = 0.5;
        for (std::size_t i = 0; i < series * bins; ++i)
            power.push_back((1 + 1 / lam[i % bins]) * ordinate(random));
    }
};

Model<double> model_of(Family family, Hold hold = kNothing, double held = 0) {
    return Model<double>{family, 2.0, hold, held, std::log(0.01), 0.0};
}

double held_value(Hold hold) {
    return hold == kHoldOrder ? 0.7 : hold == kHoldFeedback ? -0.2 : hold == kHoldParameter ? -3.0 : 0.4;
}

// Slopes by differences about a point well inside.
void check_slopes(const Target& target, const Model<double>& model, std::mt19937& random) {
    std::uniform_real_distribution<double> some(0.3, 1.2);
    Point<double> at = Point<double>();
    for (double& coordinate : at.theta) coordinate = some(random);
    if (model.hold == kHoldWeight) at.theta[0] = -at.theta[0];
    evaluate(target, model, at);
    CAPTURE(model.family);
    CAPTURE(model.hold);
    REQUIRE(at.nll < kImpossible);
    for (int i = 0; i < free_of(model); ++i) {
        Point<double> less = at, more = at;
        less.theta[i] -= 1e-5;
        more.theta[i] += 1e-5;
        evaluate(target, model, less);
        evaluate(target, model, more);
        CAPTURE(i);
        CHECK(at.gradient[i] == doctest::Approx((more.nll - less.nll) / 2e-5).epsilon(1e-4).scale(10));
        CHECK(at.fisher[i][i] >= 0);
    }
}

}  // namespace

TEST_CASE("the logarithm is that of the library") {
    for (double x = 1e-290; x < 1e290; x *= 1.7321)
        CHECK(fltea::engine::log(x) == doctest::Approx(std::log(x)).epsilon(1e-15));
    for (double x = 0.5; x < 2; x += 0.001) {
        typedef fltea::engine::Pack<double, fltea::engine::kWidth> Wide;
        CHECK(std::fabs(fltea::engine::log(x) - std::log(x)) <= 3e-16 * std::fabs(std::log(x)) + 1e-300);
        CHECK(fltea::engine::log(Wide(x))[1] == fltea::engine::log(x));
    }
}

TEST_CASE("slopes of all models are the differences of -log L") {
    std::mt19937 random(3);
    const Example example(43, 1, 1);
    const Spectra spectra(example.lam.data(), example.counts.data(), example.power.data(), 43, 1);
    const Target target = spectra.target(kernel_baseline, 0);
    for (int turn = 0; turn < 20; ++turn) {
        for (int family = 0; family < kFamilies; ++family)
            check_slopes(target, model_of(static_cast<Family>(family)), random);
        for (Hold hold : kScaledHolds)
            check_slopes(target, model_of(kFractional, hold, held_value(hold)), random);
        for (Hold hold : {kHoldState, kHoldNoise})
            check_slopes(target, model_of(kFractional, hold, 0.6), random);
    }
}

TEST_CASE("searches end inside their bounds, from anywhere and for any number of bins") {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> anywhere(-60, 60);
    for (std::size_t bins = 2; bins < 20; ++bins) {
        const Example example(bins, 2, static_cast<unsigned>(bins));
        const Spectra spectra(example.lam.data(), example.counts.data(), example.power.data(), bins, 2);
        for (int family = 0; family < kFamilies; ++family) {
            const Model<double> model = model_of(static_cast<Family>(family));
            double low[Room<double>::kFree], high[Room<double>::kFree];
            bounds(model, low, high);
            for (int turn = 0; turn < 20; ++turn) {
                double start[Room<double>::kFree];
                for (double& coordinate : start) coordinate = anywhere(random);
                Point<double> best = Point<double>();
                best.nll = kImpossible;
                try_start(spectra.target(kernel_baseline, 1), model, start, 60, best);
                REQUIRE(std::isfinite(best.nll));
                CHECK(best.nll < kImpossible);
                for (int i = 0; i < free_of(model); ++i) {
                    CHECK(best.theta[i] >= low[i]);
                    CHECK(best.theta[i] <= high[i]);
                }
            }
        }
    }
}

TEST_CASE("a grid gives one start of each of the best groups") {
    const Example example(33, 3, 5);
    const Spectra spectra(example.lam.data(), example.counts.data(), example.power.data(), 33, 3);
    const double points[] = {-1, 0, -1, 1, 2, 0, 2, 1, 4, 0};  // AR(1): pole, share
    const std::int64_t group[] = {0, 0, 2, 2, 1};
    const std::vector<std::size_t> found =
        best_starts(kernel_baseline, spectra, model_of(kAr1), Grid{points, group, 5, 3}, 4);
    REQUIRE(found.size() == 12);
    for (std::size_t s = 0; s < 3; ++s) {
        double before = -kImpossible;
        for (std::size_t k = 0; k < 3; ++k) {
            Point<double> point = Point<double>();
            std::copy(points + 2 * found[4 * s + k], points + 2 * found[4 * s + k] + 2, point.theta);
            evaluate(spectra.target(kernel_baseline, s), model_of(kAr1), point);
            CHECK(point.nll >= before);
            before = point.nll;
        }
        CHECK(found[4 * s + 3] == found[4 * s + 2]);
    }
}

TEST_CASE("ends of intervals are ordered and within what is possible") {
    for (unsigned seed = 0; seed < 6; ++seed) {
        const std::size_t bins = 9 + 13 * seed;
        const Example example(bins, 1, seed);
        const Spectra spectra(example.lam.data(), example.counts.data(), example.power.data(), bins, 1);
        Point<double> best = Point<double>();
        best.nll = kImpossible;
        const double start[] = {0.6, -1, 0, 0};
        try_start(spectra.target(kernel_baseline, 0), model_of(kFractional), start, 60, best);
        const double most = std::log(2 * spectra.mean_power(0));
        const Critical some = {3.841, 4.6};
        const Profiled what[] = {{kHoldWeight, false, 0, -2, 2, some},
                                 {kHoldOrder, false, best.theta[0], 0, 2, some},
                                 {kHoldFeedback, true, -1, -13, 1.38, some},
                                 {kHoldParameter, true, 1, -3.2, 10.6, some},
                                 {kHoldState, true, most - 1, most - 13, most, some},
                                 {kHoldNoise, true, most - 13, most - 13, most, some}};
        Profile profile(kernel_baseline, spectra, best.theta, best.scale, best.nll, 0.01);
        Ends found[6];
        profile.ends(what, 6, found);
        for (int i = 0; i < 6; ++i) {
            CHECK(found[i].low >= what[i].low);
            CHECK(found[i].low <= found[i].high);
            CHECK(found[i].high <= what[i].high);
        }
    }
}
