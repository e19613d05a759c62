// Tests of the device's noise fit, whose results are compared with the host's for the same bins.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "fit_rig.hpp"
#include "sliced_fit.hpp"
#include "whittle_fit.hpp"

namespace {

using namespace fltea::whittle;
namespace models = fltea::noise_models;

// Returns the device's bins in the form that the host's fit takes, by rising frequency (`lam`).
template <class Any>
models::Bins on_host(const Any& bins) {
    models::Numbers lam, counts, power;
    std::vector<int> order;
    for (int i = 0; i < bins.size(); ++i) order.push_back(i);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return bins.lam(a) < bins.lam(b); });
    for (int i : order) {
        lam.push_back(static_cast<double>(bins.lam(i)));
        counts.push_back(static_cast<double>(bins.counts(i)));
        power.push_back(static_cast<double>(bins.power(i)));
    }
    const models::Numbers none(lam.size());
    return models::Bins(models::kernel_baseline, lam, counts, power, none, none, 1);
}

// The free parameters and -log L of the host's fit, which begins at many points.
struct HostFit {
    std::vector<double> eta;
    double nll;
};
// Fits white noise and `part`, whose order is fixed at `order`. If `order` is -1, the order is fitted, too.
HostFit host_fit(models::Bins bins, models::Part part, double highest_order, double order = -1) {
    const models::Terms terms = {models::Term{models::kWhite, 0}, models::Term{part, 0}};
    bins.highest_order = highest_order;
    models::Patience patience;
    patience.steps = 200;
    patience.slowest = 1000;
    std::mt19937 random(1);
    std::uniform_real_distribution<double> some(-6, 6);
    const double power = std::log(bins.mean);
    HostFit best = {{}, std::numeric_limits<double>::infinity()};
    for (int k = 0; k < 40; ++k) {
        std::vector<double> eta = {power + some(random)};
        if (part == models::kOrder) eta.push_back(0.05 + highest_order * (k % 10) / 10);
        if (part == models::kRelaxation) eta.push_back(power + some(random));
        eta.push_back(some(random));
        if (part == models::kOrder) eta.push_back(power + some(random));
        if (order >= 0) eta[1] = order;
        const double nll = models::score(bins, terms, eta.data(), order >= 0 ? 1 : -1, patience);
        if (nll < best.nll) best = {eta, nll};
    }
    return best;
}

// Returns -log L of white noise.
double white_fit(const models::Bins& bins) {
    double eta = std::log(bins.mean);
    return models::score(bins, {models::Term{models::kWhite, 0}}, &eta, -1, models::Patience());
}

// Returns the standard deviation of α by the likelihood's curvature at the device's result, in double.
template <class Any>
double order_std_in_double(const Any& bins, const FitFigures& found) {
    const models::Bins on = on_host(bins);
    const double share = static_cast<double>(-found.g) * std::exp2(-static_cast<double>(found.alpha));
    const double eta[] = {std::log(static_cast<double>(found.R)), static_cast<double>(found.alpha),
                          std::log(share / (1 - share)), std::log(static_cast<double>(found.s2))};
    models::Spectrum at(on);
    REQUIRE(std::isfinite(at.at({models::Term{models::kWhite, 0}, models::Term{models::kOrder, 0}}, eta)));
    double gradient[models::kMostFree], information[models::kMostFree][models::kMostFree];
    at.derivatives(4, gradient, information);
    REQUIRE(models::factor(4, information));
    double column[] = {0, 1, 0, 0};
    models::substitute(4, information, column, true);
    return std::sqrt(column[1]);
}

// Returns 2 log L of the host's best fit with any order, minus that of its best fit with this order.
template <class Any>
double below_best(const Any& bins, double order) {
    const models::Bins on = on_host(bins);
    const double highest = models::kHighestOrder, best = host_fit(on, models::kOrder, highest).nll;
    return 2 * (host_fit(on, models::kOrder, highest, order).nll - best);
}

template <class Any>
int fit(const Any& bins, SlicedFit<Any>& sliced, FitMemory& memory) {
    sliced.begin(bins, kFivePercent, memory);
    int slices = 0;
    while (!sliced.work(bins)) REQUIRE(++slices < 1000000);
    return slices;
}

// The spectrum of an axis, and the fit of that spectrum, which starts from the result of the last fit.
struct Axis {
    void fit_now() {
        make_bins(octaves, bins);
        slices = fit(bins, sliced, memory);
    }

    Octaves octaves;
    Gathered bins;
    SlicedFit<Gathered> sliced;
    FitMemory memory;
    int slices = 0;
};

}  // namespace

TEST_CASE("sliced fit: answers are the host's of the same bins") {
    int whites = 0, fractionals = 0, relaxations = 0;
    for (int kind = 0; kind < 5; ++kind) {
        for (int n : {3000, 60000, 150000}) {
            std::unique_ptr<Axis> axis(new Axis);
            const int parts[] = {0, 1, 4, 6, 1};
            const double shares[] = {0, 0.6, 0.5, 1.2, 3.0};
            Counts next(parts[kind], shares[kind], 4.0, static_cast<unsigned long long>(kind + 1));
            for (int k = 0; k < n; ++k) axis->octaves.add(next());
            axis->fit_now();
            const FitFigures cold = axis->memory.figures();
            const models::Bins host = on_host(axis->bins);
            const HostFit full = host_fit(host, models::kOrder, models::kHighestOrder);
            const HostFit up_to_one = host_fit(host, models::kOrder, 1);
            const HostFit relaxation = host_fit(host, models::kRelaxation, 1);
            CAPTURE(kind);
            CAPTURE(n);
            CAPTURE(cold.alpha);
            CAPTURE(full.eta[1]);
            CAPTURE(cold.alpha_std);
            const double ratio = 2 * (white_fit(host) - up_to_one.nll);
            // For white noise, the likelihood has many maxima of nearly the same height. The likelihood
            // ratios are small then, and the device's may be lower than the host's by 0.5.
            CHECK(static_cast<double>(cold.ratio_white) <= ratio + 0.05 + 2e-3 * ratio);
            CHECK(static_cast<double>(cold.ratio_white) >= ratio - (ratio < 6 ? 0.5 : 0.05 + 2e-3 * ratio));
            // For white noise, the likelihood has many maxima at orders above 1, and the fit need not find
            // any particular one.
            if (cold.verdict != Verdict::white) {
                CHECK(static_cast<double>(cold.ratio_ar1) ==
                      doctest::Approx(2 * (relaxation.nll - full.nll)).epsilon(2e-3).scale(20));
            }
            whites += cold.verdict == Verdict::white;
            fractionals += cold.verdict == Verdict::fractional;
            relaxations += cold.verdict == Verdict::relaxation;
            if (cold.verdict != Verdict::white && cold.alpha_defined) {
                CHECK(std::fabs(static_cast<double>(cold.alpha) - full.eta[1]) <
                      0.1 * 1.96 * static_cast<double>(cold.alpha_std));
            }
            // A second fit starts from the results of the first one, and needs only a fraction of the work.
            const int evaluations = axis->sliced.evaluations();
            axis->fit_now();
            CHECK(axis->sliced.evaluations() * 5 < evaluations);
            CHECK(axis->memory.figures().ratio_white >= cold.ratio_white - 0.02f);
            CHECK(axis->memory.figures().verdict == cold.verdict);
            if (n > 3000) continue;
            // With five times as many samples, the last result is no good start, so the grid is searched.
            for (int k = 0; k < 4 * n; ++k) axis->octaves.add(next());
            axis->fit_now();
            CHECK(axis->sliced.evaluations() * 2 > evaluations);
        }
    }
    CHECK(whites == 3);
    CHECK(fractionals >= 4);
    CHECK(relaxations >= 3);
}

TEST_CASE("sliced fit: from the last answer it finds what a search of the whole grid finds") {
    int compared = 0, worse = 0, apart = 0, orders = 0;
    for (int kind = 0; kind < 4; ++kind) {
        for (unsigned long long seed = 1; seed <= 4; ++seed) {
            // Kinds of noise: white noise, a weak and a strong sum of relaxations, and a single relaxation,
            // which has order 1.
            const int parts[] = {0, 4, 4, 1};
            const double shares[] = {0, 0.1, 0.5, 0.3};
            Counts next(parts[kind], shares[kind], 3.0, seed);
            std::unique_ptr<Axis> axis(new Axis);
            for (int k = 0; k < 16000; ++k) {
                axis->octaves.add(next());
                if (k < 1000 || k % 300 != 0) continue;
                axis->fit_now();
                const FitFigures found = axis->memory.figures();
                // AR(1) is a special case of the fractional model, which therefore never fits worse.
                CHECK((found.verdict == Verdict::white || found.ratio_ar1 > -0.01f));
                if (k % 1500 != 0 || k < 6000) continue;
                FitMemory fresh;
                fit(axis->bins, axis->sliced, fresh);
                const FitFigures cold = fresh.figures();
                ++compared;
                worse += found.ratio_white < cold.ratio_white - 0.3f;
                if (!cold.alpha_defined || cold.alpha_std > 0.2f) continue;
                ++orders;
                apart += !(std::fabs(found.alpha - cold.alpha) < 0.2f * cold.alpha_std);
            }
        }
    }
    CAPTURE(compared);
    CAPTURE(orders);
    CHECK(worse <= compared / 10);
    CHECK(apart <= orders / 6);
    CHECK(orders > 30);
}

TEST_CASE("sliced fit: the interval is that of double, however small the share of the white noise") {
    int defined = 0, small = 0, wider = 0, too_short = 0, too_long = 0;
    for (double phi : {0.3, 0.5, 0.9}) {
        for (double deviation : {0.5, 4.0}) {
            for (int n : {6000, 60000}) {
                for (unsigned long long seed = 1; seed <= 6; ++seed) {
                    Noise random(seed);
                    std::unique_ptr<Axis> axis(new Axis);
                    double x = 0;
                    for (int k = 0; k < n; ++k) {
                        x = phi * x + 3 * deviation * std::sqrt(1 - phi * phi) * random();
                        axis->octaves.add(static_cast<std::int16_t>(std::floor(x + 3 * random() + 0.5)));
                    }
                    axis->fit_now();
                    const Gathered& bins = axis->bins;
                    const FitFigures& found = axis->memory.figures();
                    CAPTURE(phi);
                    CAPTURE(deviation);
                    CAPTURE(n);
                    CAPTURE(seed);
                    REQUIRE(std::isfinite(found.alpha_std));
                    CHECK((found.alpha_std > 0 || !found.alpha_defined));
                    if (!found.alpha_defined) continue;
                    ++defined;
                    small += found.R < 0.05f * bins.mean_power();
                    // The interval of α is at least as wide as the likelihood's curvature says. It is wider
                    // where it has to be: at each end, 2 log L is 3.84 below its maximum (95 %).
                    const double curvature = order_std_in_double(bins, found);
                    const double half = 1.96 * static_cast<double>(found.alpha_std);
                    const double alpha = static_cast<double>(found.alpha);
                    CHECK(half > 0.98 * 1.96 * curvature);
                    const double low = below_best(bins, std::max(0.0, alpha - 1.1 * half));
                    const double high = below_best(bins, std::min(1.99, alpha + 1.1 * half));
                    too_short += (alpha > 1.1 * half && low < 3.84) || high < 3.84;
                    if (half < 1.02 * 1.96 * curvature) continue;
                    ++wider;
                    const double inside = std::min(below_best(bins, std::max(0.0, alpha - 0.9 * half)),
                                                   below_best(bins, std::min(1.99, alpha + 0.9 * half)));
                    too_long += inside > 3.84;
                }
            }
        }
    }
    CHECK(defined > 40);
    CHECK(small > 5);
    CHECK(wider > 5);
    CHECK(too_short <= defined / 12);
    CHECK(too_long <= wider / 4);
}

TEST_CASE("sliced fit: R of white noise is its variance") {
    for (unsigned long long seed = 1; seed <= 40; ++seed) {
        std::unique_ptr<Axis> axis(new Axis);
        Counts next(0, 0, 3.0, seed);
        for (int k = 0; k < 6000; ++k) axis->octaves.add(next());
        axis->fit_now();
        const FitFigures& found = axis->memory.figures();
        if (found.verdict != Verdict::white) continue;
        CHECK(static_cast<double>(found.R) == doctest::Approx(9 + 1.0 / 12).epsilon(0.08));
        CHECK(found.alpha == 0);
        CHECK(found.alpha_std == 0);
        CHECK(found.g == 0);
        CHECK(found.s2 == 0);
        CHECK_FALSE(found.alpha_defined);
    }
}

TEST_CASE("sliced fit: without ordinates, or without power in them, there is no fit") {
    for (bool constant : {false, true}) {
        std::unique_ptr<Axis> axis(new Axis);
        Counts next(0, 0, 3.0, 1);
        for (int k = 0; k < 20000; ++k) {
            // There are so many gaps that no stretch of samples is long enough for a spectrum.
            if (!constant && k % 50 == 0) axis->octaves.skip(90);
            axis->octaves.add(constant ? std::int16_t(-32768) : next());
        }
        axis->fit_now();
        CHECK(axis->slices == 0);
        CHECK(axis->sliced.evaluations() == 0);
        CHECK_FALSE(axis->sliced.searched());
        const FitFigures& found = axis->memory.figures();
        CHECK(found.verdict == Verdict::none);
        for (float one : {found.alpha, found.alpha_std, found.g, found.s2, found.R, found.ratio_white,
                          found.ratio_ar1, found.ordinates}) {
            CHECK(one == 0);
        }
        // As soon as a stretch of samples is long enough, its spectrum is fitted.
        axis->octaves.skip(1000);
        for (int k = 0; k < 2000; ++k) axis->octaves.add(next());
        axis->fit_now();
        CHECK(found.verdict != Verdict::none);
        CHECK(axis->sliced.searched());
    }
}

namespace {

// Bins of a given spectrum with random errors, as small as those of a spectrum of years of samples.
struct YearBins {
    enum { kSize = 170 };
    float lam_[kSize], counts_[kSize], power_[kSize];
    float ordinates_ = 0, sum_ = 0;

    YearBins(double alpha, double g, double weight, double ordinates, unsigned seed) {
        std::mt19937 random(seed);
        std::normal_distribution<double> normal(0, 1);
        const double pi = 3.14159265358979323846;
        for (int i = 0; i < kSize; ++i) {
            const double l = pi * std::exp2(-0.1 * (kSize - i)) * 0.99, size = 2 * std::sin(l / 2);
            const double count = std::max(2.0, 0.069 * ordinates * l / pi);
            const double turn = alpha * (pi - l) / 2 + l, r = std::pow(size, alpha);
            const double S = weight / (r * r - 2 * g * r * std::cos(turn) + g * g) + 1 - weight;
            lam_[i] = static_cast<float>(l);
            counts_[i] = static_cast<float>(count);
            // The power of a bin is the mean of exponentially distributed ordinates. It is drawn by Wilson
            // and Hilferty's approximation.
            const double cube = 1 - 1 / (9 * count) + normal(random) / (3 * std::sqrt(count));
            power_[i] = static_cast<float>(5 * S * cube * cube * cube);
            ordinates_ += counts_[i];
            sum_ += counts_[i] * power_[i];
        }
    }
    int size() const { return kSize; }
    float ordinates() const { return ordinates_; }
    float mean_power() const { return sum_ / ordinates_; }
    float lam(int i) const { return lam_[i]; }
    float counts(int i) const { return counts_[i]; }
    float power(int i) const { return power_[i]; }
    float ln_size(int i) const { return std::log(2 * std::sin(lam_[i] / 2)); }
};

}  // namespace

TEST_CASE("sliced fit: float has enough digits for a year of samples") {
    for (double ordinates : {1e4, 1e6, 1e8, 1.5e9}) {
        for (int kind = 0; kind < 3; ++kind) {
            const double alpha = kind == 0 ? 0.5 : kind == 1 ? 0.8 : 0.3, weight = kind == 1 ? 0.2 : 0.02;
            const YearBins bins(alpha, -0.02, weight, ordinates, static_cast<unsigned>(kind + 7));
            std::unique_ptr<SlicedFit<YearBins>> sliced(new SlicedFit<YearBins>);
            FitMemory memory;
            fit(bins, *sliced, memory);
            const FitFigures& found = memory.figures();
            const HostFit full = host_fit(on_host(bins), models::kOrder, models::kHighestOrder);
            CAPTURE(ordinates);
            CAPTURE(kind);
            CAPTURE(found.alpha);
            CAPTURE(full.eta[1]);
            CHECK(std::fabs(static_cast<double>(found.alpha) - full.eta[1]) <
                  0.1 * 1.96 * static_cast<double>(found.alpha_std));
            CHECK(found.verdict != Verdict::white);
        }
    }
}

TEST_CASE("sliced fit: the verdict is by 5 % of the null test and by 6 above a relaxation, close to both") {
    struct Trial {
        int parts;
        double share;
    };
    double below_null = -1e9, above_null = 1e9, below_apart = -1e9, above_apart = 1e9;
    for (const Trial& trial : {Trial{0, 0.0}, Trial{1, 0.12}, Trial{4, 0.25}, Trial{5, 0.2}}) {
        for (unsigned long long seed = 1; seed <= 3; ++seed) {
            Counts counts(trial.parts, trial.share, 20.0, seed);
            const std::unique_ptr<Axis> axis(new Axis);
            axis->memory = FitMemory(0);
            for (int round = 0; round < 20; ++round) {
                for (int k = 0; k < 600; ++k) axis->octaves.add(counts());
                axis->fit_now();
                const FitFigures f = axis->memory.figures();
                const double x = std::log10(static_cast<double>(f.ordinates));
                const double white =
                    static_cast<double>(f.ratio_white) - (3.7125 + 1.0516 * x - 0.0805 * x * x);
                const double apart = static_cast<double>(f.ratio_ar1) - 6.0;
                if (std::abs(white) < 1e-3 || std::abs(apart) < 1e-3) continue;
                CHECK((f.verdict == Verdict::white) == (white < 0));
                (white < 0 ? below_null : above_null) =
                    white < 0 ? std::max(below_null, white) : std::min(above_null, white);
                if (white < 0) continue;
                CHECK((f.verdict == Verdict::fractional) == (apart > 0));
                (apart < 0 ? below_apart : above_apart) =
                    apart < 0 ? std::max(below_apart, apart) : std::min(above_apart, apart);
            }
        }
    }
    CHECK(below_null > -0.5);
    CHECK(above_null < 0.5);
    CHECK(below_apart > -0.5);
    CHECK(above_apart < 0.5);
}
