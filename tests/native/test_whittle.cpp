// Tests of noise models and their fits: derivatives are compared with differences, fits have to end inside
// their bounds, and the model search has to find the models from which the spectra were made.
#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "pack_log.hpp"
#include "whittle_interval.hpp"
#include "whittle_search.hpp"

namespace {

using namespace fltea::noise_models;

// Returns bins of a spectrum whose width is proportional to the frequency, like those of the live spectrum.
// Their powers are 1.
Bins bins_of(std::size_t size, double samples = 60000) {
    Numbers lam, counts, walk;
    const double lowest = 25 / samples, ratio = std::pow(kPi / lowest, 1 / static_cast<double>(size));
    for (std::size_t i = 0; i < size; ++i) {
        const double begin = lowest * std::pow(ratio, static_cast<double>(i)), end = begin * ratio;
        lam.push_back((begin + end) / 2);
        counts.push_back(std::fmax(1.0, (end - begin) * samples / (2 * kPi)));
        walk.push_back(1 / std::pow(2 * std::sin(lam.back() / 2), 2));
    }
    return Bins(kernel_baseline, lam, counts, Numbers(size, 1.0), walk, Numbers(size), 0.01);
}

// Returns the same bins with other powers.
Bins with_power(const Bins& bins, const Numbers& power) {
    return Bins(kernel_baseline, bins.lam, bins.counts, power, bins.walk, Numbers(bins.size()), 0.01);
}

Numbers spectrum(const Bins& bins, const Terms& terms, const std::vector<double>& eta) {
    Spectrum at(bins);
    at.at(terms, eta.data());
    return at.total();
}

// Draws a random power for each bin, distributed like the mean of the bin's exponentially distributed
// ordinates. The expected powers are `power`.
Numbers drawn(const Bins& bins, Numbers power, unsigned seed) {
    std::mt19937 random(seed);
    for (std::size_t i = 0; i < power.size(); ++i)
        power[i] *= std::gamma_distribution<double>(bins.counts[i], 1 / bins.counts[i])(random);
    return power;
}

const Part kAll[] = {kRelaxation, kWalk,     kOrder,  kResonance, kQuantised,   kRise,
                     kLowPass,    kSharp,    kNotch,  kMean,      kAlternating, kFloor,
                     kOrderByF,   kOrderByf, kArfima, kHighPass};

// Returns free parameters of a noise part. They are well inside their bounds, and computed from three numbers
// between 0.3 and 0.9.
std::vector<double> inside(Part part, double a, double b, double c) {
    switch (part) {
        case kWhite:
        case kQuantised:
        case kSharp:
        case kFloor:
            return {a};
        case kRelaxation:
            return {a, -4 * b};
        case kWalk:
            return {a - 4};
        case kOrder:
            return {a, -4 * b, c};
        case kResonance:
            return {a, -4 * b, -1 - c};
        case kRise:
            return {a, b};
        case kLowPass:
            return {-3 * a, -b};
        case kNotch:
            return {-b, -c};
        case kMean:
            return {};
        case kAlternating:
            return {a, -b};
        case kArfima:
        case kArfimaByStep:
            return {a, -b, c};
        case kHighPass:
            return {-2 - 8 * a, -3 - 2 * b};
        case kOrderByF:
            return {a - 0.5, b - 0.5, c};
        case kOrderByf:
            return {a, 2 * b, c};
        case kOrderByQ:
            return {a, -4 * b, c};
    }
    return {};
}

// A model of white noise, a relaxation and one more part, with parameters well inside their bounds.
struct Example {
    Terms terms;
    std::vector<double> eta;

    Example(Part part, std::mt19937& random)
        : terms{{kWhite, 0}, {kRelaxation, 0}, {part, 3}}, eta{0, 0, -3} {
        std::uniform_real_distribution<double> some(0.3, 0.9);
        const double a = some(random), b = some(random), c = some(random);
        for (const double one : inside(part, a, b, c)) eta.push_back(one);
    }
};

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

TEST_CASE("noise models: slopes of all parts are the differences of the spectrum and of -log L") {
    std::mt19937 random(3);
    const Bins plain = bins_of(43);
    const Bins bins = with_power(plain, drawn(plain, Numbers(43, 3.0), 1));
    for (int turn = 0; turn < 20; ++turn) {
        for (Part part : kAll) {
            Example one(part, random);
            CAPTURE(part);
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
        REQUIRE(eta.size() == static_cast<std::size_t>(row.coordinates.count));
        REQUIRE(bins.kernel->term(columns, Term{row.part, 3}, eta.data(), part.data(), slope));
        for (const double one : part) REQUIRE(std::isfinite(one));
        for (const double one : spare) REQUIRE(std::isfinite(one));
    }
}

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
            for (Part part : kAll) {
                Example one(part, random);
                for (double& coordinate : one.eta) coordinate = anywhere(random);
                CAPTURE(size);
                CAPTURE(kind);
                CAPTURE(part);
                const double nll = score(bins, one.terms, one.eta.data(), -1, Patience());
                CHECK_FALSE(std::isnan(nll));
                double low[kMostFree], high[kMostFree];
                int next = 0;
                for (const Term& term : one.terms) {
                    bounds_of(term, bins, 1, low + next, high + next);
                    next += free_of(term.part);
                }
                for (int i = 0; i < next; ++i) {
                    CHECK(one.eta[static_cast<std::size_t>(i)] >= low[i]);
                    CHECK(one.eta[static_cast<std::size_t>(i)] <= high[i]);
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
        // The error of the order may be 1.7 times half the interval, which is 3.3 standard deviations.
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
                for (double coordinate : one->eta) CHECK(std::isfinite(coordinate));
            }
        }
    }
}
