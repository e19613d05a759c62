// Tests of the model search: it has to find the models from which the spectra were made.
#include <doctest/doctest.h>

#include <cmath>
#include <string>
#include <vector>

#include "whittle_interval.hpp"
#include "whittle_rig.hpp"
#include "whittle_search.hpp"

TEST_CASE(
    "noise models: every part can be found: white noise is there, and all others are tried by a search") {
    const Bins bins = bins_of(43);
    std::vector<bool> tried(kParts, false);
    for (const Candidates& list : {parts_to_add(bins), filters_to_add(bins), orders_to_add(bins)})
        for (const Candidate& one : list) tried[one.term.part] = true;
    for (const Row& row : kTable) {
        CAPTURE(std::string(row.name));
        CHECK(tried[row.part] == (row.part != kWhite && !row.is(kOther)));
    }
}

TEST_CASE("noise models: the score of a part says what fitting it gains, where that is little") {
    const Bins plain = bins_of(80, 20000);
    for (Part part : {kRelaxation, kWalk, kQuantised}) {
        const Terms white = {{kWhite, 0}}, both = {{kWhite, 0}, {part, 0}};
        const double levels[] = {0, -5, -13, 0, 0, -4};
        std::vector<double> truth = {0, levels[part]};
        if (part == kRelaxation) truth.push_back(-3);
        const Bins bins = with_power(plain, spectrum(plain, both, truth));
        std::vector<double> eta = {0};
        const double before = score(bins, white, eta.data(), -1, Patience());
        Gains gains(bins, white, eta.data());
        const Gain found = gains.of(candidate(bins, Term{part, 0}, truth[1], -3, 0));
        const double after = score(bins, both, truth.data(), -1, Patience());
        CAPTURE(part);
        CHECK(2 * (before - after) > 1);
        CHECK(found.gain == doctest::Approx(2 * (before - after)).epsilon(0.35));
        CHECK(std::fabs(found.log_power) < 0.35);
    }
}

TEST_CASE("noise models: on exact spectra the search finds what they are made of") {
    struct Case {
        Terms terms;
        std::vector<double> eta;
    };
    const Case cases[] = {
        {{{kWhite, 0}}, {0}},
        {{{kWhite, 0}, {kRelaxation, 0}}, {0, 0, -3}},
        {{{kWhite, 0}, {kRelaxation, 0}, {kRelaxation, 0}}, {0, 0, -1.5, 0, -5}},
        {{{kWhite, 0}, {kWalk, 0}}, {0, -9}},
        {{{kWhite, 0}, {kQuantised, 0}}, {0, 0}},
        {{{kWhite, 0}, {kResonance, 0}}, {0, 3, -1, -2}},
        {{{kWhite, 0}, {kNotch, 0}}, {0, 0, -1}},
        {{{kWhite, 0}, {kSharp, 0}}, {0, 0.2}},
        {{{kWhite, 0}, {kHighPass, 0}}, {0, -6, -3}},
        {{{kWhite, 0}, {kHighPass, 0}, {kRelaxation, 0}}, {0, -6, -3, 2, -2}},
        {{{kWhite, 0}, {kMean, 4}}, {0}},
        {{{kWhite, 0}, {kQuantised, 0}, {kRelaxation, 0}}, {0, 0, 0, -3}},
    };
    for (const Case& one : cases) {
        const Bins plain = bins_of(150);
        Bins bins = with_power(plain, spectrum(plain, one.terms, one.eta));
        const Frontier found = Search(bins).whole();
        CAPTURE(one.terms.back().part);
        REQUIRE(found.plain.same_terms(FittedModel{one.terms, {}, 0}));
        for (std::size_t i = 0; i < one.eta.size(); ++i)
            CHECK(found.plain.eta[i] == doctest::Approx(one.eta[i]).epsilon(0.02).scale(1));
        CHECK(found.plain.nll <= found.white.nll);
        // A second fit from these parameters gives the same result.
        const Frontier again = Search(bins).again(found);
        CHECK(again.plain.nll == doctest::Approx(found.plain.nll).epsilon(1e-9));
    }
}

TEST_CASE("noise models: a part that is searched apart is found, and is not added in any other search") {
    const Bins plain = bins_of(150);
    const Terms both = {{kWhite, 0}, {kRelaxation, 0}, {kWalk, 0}};
    Bins bins = with_power(plain, spectrum(plain, both, {0, 0, -3, -9}));
    CHECK(Search(bins, {kWalk}).whole().plain.same_terms(FittedModel{both, {}, 0}));
    // A part is added to a model if it raises 2 log L by more than a price for its parameters. The price in
    // the search for `plain` is higher than in that for `rich`. The gain by this random walk is between the
    // two.
    Bins faint = with_power(plain, spectrum(plain, {{kWhite, 0}, {kWalk, 0}}, {0, -15}));
    const Frontier with = Search(faint).whole(), without = Search(faint, {kWalk}).whole();
    CHECK_FALSE(with.plain.has(kWalk));
    CHECK(with.rich.has(kWalk));
    CHECK_FALSE(without.rich.has(kWalk));
}

TEST_CASE("noise models: an order is found beside none, and its interval holds it") {
    for (double alpha : {0.3, 0.5, 0.7}) {
        const Bins plain = bins_of(150, 600000);
        const Terms terms = {{kWhite, 0}, {kOrder, 0}};
        const std::vector<double> truth = {0, alpha, -4, -1};
        Bins bins = with_power(plain, drawn(plain, spectrum(plain, terms, truth), 7));
        const Frontier found = Search(bins).whole();
        CAPTURE(alpha);
        REQUIRE(found.ordered.same_terms(FittedModel{terms, {}, 0}));
        CHECK(found.ordered.nll < found.plain.nll);
        double ends[2];
        for (int side : {-1, 1}) {
            std::vector<double> away;
            const auto end = [&] {
                return interval_end(bins, terms, found.ordered.eta, found.ordered.nll, 1, side,
                                    side > 0 ? 1.9 : 0, 0.03, Critical{3.841, 3.841}, Patience(), away);
            };
            ends[side > 0] = end();
            CHECK(away[1] == ends[side > 0] - found.ordered.eta[1]);
            // A second search for the end of the interval starts at the end that the first search found, and
            // finds the same end.
            CHECK(end() == ends[side > 0]);
        }
        CHECK(ends[0] < found.ordered.eta[1]);
        CHECK(found.ordered.eta[1] < ends[1]);
        // The interval covers 95 %, so half of it is 1.96 standard deviations. The error may be 3.3 of them.
        CHECK(std::fabs(found.ordered.eta[1] - alpha) < 1.7 * (ends[1] - ends[0]) / 2);
        // At each end of the interval, the likelihood has fallen by the required amount.
        for (double end : ends) {
            std::vector<double> eta = found.ordered.eta;
            eta[1] = end;
            CHECK(2 * (score(bins, terms, eta.data(), 1, Patience()) - found.ordered.nll) ==
                  doctest::Approx(3.841).epsilon(0.02));
        }
    }
}

TEST_CASE("noise models: a search finds the same whatever was searched before") {
    const Bins small = bins_of(40);
    const auto found = [](const Bins& plain, unsigned seed, double power) {
        Bins bins = with_power(plain, drawn(plain, Numbers(plain.size(), power), seed));
        return Search(bins).whole();
    };
    const Frontier first = found(small, 1, 1e-3);
    for (const Bins& other : {small, bins_of(60), bins_of(50), bins_of(40, 3000)}) found(other, 2, 1e6);
    const Frontier again = found(small, 1, 1e-3);
    CHECK(again.plain.eta == first.plain.eta);
    CHECK(again.rich.eta == first.rich.eta);
    CHECK(again.null.eta == first.null.eta);
    CHECK(again.ordered.nll == first.ordered.nll);
}

TEST_CASE("noise models: a search of data that are no spectrum ends, with finite numbers") {
    for (std::size_t size : {2, 3, 7, 40}) {
        const Bins plain = bins_of(size);
        for (int kind = 0; kind < 3; ++kind) {
            Numbers power(size, 0.0);
            for (std::size_t i = 0; i < size; ++i) {
                if (kind == 0) power[i] = i % 2 ? 0 : 1;
                if (kind == 1) power[i] = std::pow(10.0, i % 2 ? 60 : -60);
                if (kind == 2) power[i] = i ? 0 : 1e90;
            }
            Bins bins = with_power(plain, power);
            const Frontier found = Search(bins).whole();
            CAPTURE(size);
            CAPTURE(kind);
            for (const FittedModel* one : {&found.white, &found.null, &found.plain, &found.rich}) {
                CHECK_FALSE(std::isnan(one->nll));
                for (double parameter : one->eta) CHECK(std::isfinite(parameter));
            }
        }
    }
}
