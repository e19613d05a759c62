// Tests of the spectra of noise parts: derivatives are compared with differences.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "pack_log.hpp"
#include "whittle_rig.hpp"

TEST_CASE("the logarithm is that of the library") {
    for (double x = 1e-290; x < 1e290; x *= 1.7321)
        CHECK(fltea::engine::log(x) == doctest::Approx(std::log(x)).epsilon(1e-15));
    for (double x = 0.5; x < 2; x += 0.001) {
        typedef fltea::engine::Pack<double, fltea::engine::kWidth> Wide;
        CHECK(std::fabs(fltea::engine::log(x) - std::log(x)) <= 3e-16 * std::fabs(std::log(x)) + 1e-300);
        CHECK(fltea::engine::log(Wide(x))[1] == fltea::engine::log(x));
    }
}

TEST_CASE("noise models: slopes of all parts are the differences of the spectrum and of -log L") {
    std::mt19937 random(3);
    const Bins plain = bins_of(43);
    const Bins bins = with_power(plain, drawn(plain, Numbers(43, 3.0), 1));
    for (int turn = 0; turn < 20; ++turn) {
        for (const Row& row : kTable) {
            Example one(row.part, random);
            CAPTURE(std::string(row.name));
            Spectrum at(bins), less(bins), more(bins);
            REQUIRE(std::isfinite(at.at(one.terms, one.eta.data())));
            double gradient[kMostFree], information[kMostFree][kMostFree];
            at.derivatives(free_of(one.terms), gradient, information);
            for (std::size_t i = 0; i < one.eta.size(); ++i) {
                std::vector<double> eta = one.eta;
                eta[i] -= 1e-5;
                const double below = less.at(one.terms, eta.data());
                eta[i] += 2e-5;
                const double above = more.at(one.terms, eta.data());
                CAPTURE(i);
                CHECK(gradient[i] == doctest::Approx((above - below) / 2e-5).epsilon(1e-5).scale(100));
                double worst = 0;
                for (std::size_t k = 0; k < bins.size(); ++k) {
                    const double slope = std::log(more.total()[k] / less.total()[k]) / 2e-5;
                    worst = std::fmax(worst, std::fabs(slope - at.slope(static_cast<int>(i))[k]));
                }
                CHECK(worst < 1e-6);
            }
        }
    }
}

TEST_CASE(
    "noise models: of the columns that only some parts read, each part reads those that its row names") {
    const Bins bins = bins_of(43);
    const Numbers none(bins.branch.size(), std::nan(""));
    for (const Row& row : kTable) {
        CAPTURE(std::string(row.name));
        Columns columns = bins.columns();
        if (!(row.columns & kSquare)) columns.square = none.data();
        if (!(row.columns & kTurn)) columns.cos1 = columns.sin1 = none.data();
        if (!(row.columns & kLogSize)) columns.ln_size = none.data();
        if (!(row.columns & kBranch)) columns.branch = none.data();
        Numbers part(bins.size()), spare(3 * bins.size());
        double* slope[3] = {spare.data(), spare.data() + bins.size(), spare.data() + 2 * bins.size()};
        const std::vector<double> eta = inside(row.part, 0.5, 0.6, 0.7);
        REQUIRE(eta.size() == static_cast<std::size_t>(row.free_parameters.count));
        REQUIRE(bins.kernel->term(columns, Term{row.part, 3}, eta.data(), part.data(), slope));
        for (const double one : part) REQUIRE(std::isfinite(one));
        for (const double one : spare) REQUIRE(std::isfinite(one));
    }
}

TEST_CASE("noise models: where there is no spectrum there are slopes of no meaning") {
    const Bins bins = bins_of(20);
    Spectrum at(bins);
    const double eta[] = {0, 3, 0, 0};
    CHECK(std::isinf(at.at({Term{kWhite, 0}, Term{kOrder, 0}}, eta)));
    for (int k = 0; k < 4; ++k) CHECK(at.slope(k) != nullptr);
}

TEST_CASE("noise models: columns and rows begin on lines of the cache") {
    const auto begins_on_a_line = [](const double* at) {
        return reinterpret_cast<std::uintptr_t>(at) % OnLines<double>::kLine == 0;
    };
    const Bins bins = bins_of(21);
    Spectrum at(bins);
    const double eta[] = {0, 0, 0};
    at.at({Term{kWhite, 0}, Term{kRelaxation, 0}}, eta);
    CHECK(begins_on_a_line(bins.power.data()));
    for (int k = 0; k < 3; ++k) CHECK(begins_on_a_line(at.slope(k)));
}
