// Tests of the bins of the spectrum that the device fits. They are compared with a spectrum computed in
// double.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "fit_rig.hpp"
#include "real_spectrum.hpp"
#include "sliced_fit.hpp"

namespace {

using fltea::whittle::excess;

// Subtracts from the vector y its projection on the vector `one`.
void remove(const std::vector<double>& one, std::vector<double>& y) {
    double along = 0, square = 0;
    for (std::size_t i = 0; i < y.size(); ++i) {
        along += one[i] * y[i];
        square += one[i] * one[i];
    }
    for (std::size_t i = 0; i < y.size(); ++i) y[i] -= along / square * one[i];
}

}  // namespace

TEST_CASE("fit bins: elementary functions in float are those of the library") {
    for (float x = 1e-30f; x < 1e30f; x *= 1.37f) {
        CHECK(std::fabs(fltea::math::log(x) - std::log(x)) <= 3e-7f * std::fabs(std::log(x)) + 1e-7f);
    }
    for (double u = -0.999; u < 30; u += 0.0007) {
        const float given = static_cast<float>(u);
        const double exact = static_cast<double>(given) - std::log1p(static_cast<double>(given));
        CHECK(std::fabs(static_cast<double>(excess(given)) - exact) <= 3e-6 * exact + 1e-12);
        const double log1p = std::log1p(static_cast<double>(given));
        CHECK(std::fabs(static_cast<double>(fltea::math::log1p(given)) - log1p) <=
              4e-7 * std::fabs(log1p) + 1e-7);
    }
    for (float x = -80; x < 80; x += 0.37f) {
        CHECK(fltea::math::exp(x) == doctest::Approx(std::exp(x)).epsilon(1e-6));
        CHECK(fltea::math::fmod(x, 4.0f) == doctest::Approx(std::fmod(x, 4.0f)).epsilon(1e-5));
    }
}

TEST_CASE("fit bins: ordinates of a whole stretch are those of their definition, without its cubic") {
    for (int n : {64, 65, 129, 300, 511, 512}) {
        for (bool slow : {false, true}) {
            Noise random(static_cast<unsigned long long>(n));
            std::vector<std::int32_t> x;
            for (int i = 0; i < n; ++i) {
                const double t = 2.0 * i / (n - 1) - 1;
                const double drift = slow ? 3e6 * t + 1e6 * t * t - 2e6 * t * t * t : 0;
                x.push_back(static_cast<std::int32_t>(4e7 + drift + 30000 * random()));
            }
            fltea::engine::WholeLines<512> lines;
            lines.take(x.data(), n, slow);
            // The expected result, computed in double. The mean or, if `slow`, a fitted cubic is subtracted:
            // the powers 0 to 3 of time are made orthogonal to each other, and subtracted one after the
            // other.
            std::vector<double> y(x.begin(), x.end()), expected;
            std::vector<std::vector<double>> basis;
            for (int power = 0; power <= (slow ? 3 : 0); ++power) {
                std::vector<double> one;
                for (int i = 0; i < n; ++i) one.push_back(std::pow(2.0 * i / (n - 1) - 1, power));
                for (const std::vector<double>& other : basis) remove(other, one);
                remove(one, y);
                basis.push_back(one);
            }
            double largest = 0;
            for (int j = 1; 2 * j < n; ++j) {
                double re = 0, im = 0;
                for (int i = 0; i < n; ++i) {
                    const double angle = 2 * 3.14159265358979323846 * j * i / n;
                    re += y[static_cast<std::size_t>(i)] * std::cos(angle);
                    im -= y[static_cast<std::size_t>(i)] * std::sin(angle);
                }
                expected.push_back((re * re + im * im) / n);
                largest = std::max(largest, expected.back());
            }
            for (int j = 1; 2 * j < n; ++j) {
                const double found = static_cast<double>(lines.power(j));
                const double want = expected[static_cast<std::size_t>(j - 1)];
                CHECK(std::fabs(std::sqrt(found) - std::sqrt(want)) <= 6e-5 * std::sqrt(largest));
            }
        }
    }
}

TEST_CASE("fit bins: bins of white noise have its variance, all its ordinates, and rise") {
    for (int n : {400, 1000, 20000, 200000}) {
        std::unique_ptr<Octaves> octaves(new Octaves);
        Counts next(0, 0, 3.0, 5);
        for (int k = 0; k < n; ++k) octaves->add(next());
        std::unique_ptr<Gathered> bins(new Gathered);
        make_bins(*octaves, *bins);
        CAPTURE(n);
        // The mean power is the sum of two variances: that of the noise, 9, and that of rounding to counts,
        // 1/12.
        CHECK(bins->mean_power() ==
              doctest::Approx(9 + 1.0 / 12).epsilon(4 / std::sqrt(static_cast<double>(n) / 2)));
        CHECK(static_cast<double>(bins->ordinates()) > 0.38 * n);
        CHECK(static_cast<double>(bins->ordinates()) < 0.55 * n);
        CHECK(bins->left_out() == 0);
        // The bins come octave by octave, from the highest frequencies down. The bins of the level that keeps
        // its samples come last. Within each octave, and within that last level, the frequencies rise.
        int falls = 0;
        for (int i = 1; i < bins->size(); ++i) falls += bins->lam(i) < bins->lam(i - 1);
        CHECK(falls == octaves->ladder().depth());
        for (int i = 0; i < bins->size(); ++i) {
            CHECK(bins->ln_size(i) ==
                  doctest::Approx(std::log(2 * std::sin(bins->lam(i) / 2))).epsilon(1e-5));
        }
    }
}

TEST_CASE("fit bins: bins stand at their lines' frequencies, cleared of what the filters left of them") {
    typedef fltea::engine::HalfBand<fltea::RealSpectrum<double>> Filter;
    const double turn = 2 * 3.14159265358979323846;
    // Returns the squared gain of the half-band filter at a frequency.
    const auto gain = [](double w) {
        double h = Filter::middle();
        for (int k = 0; k < Filter::kTaps; ++k) h += 2 * Filter::tap(k) * std::cos((15 - 2 * k) * w);
        return h * h;
    };
    std::unique_ptr<Octaves> octaves(new Octaves);
    Counts next(3, 0.5, 4.0, 3);
    for (int k = 0; k < 120000; ++k) octaves->add(next());
    std::unique_ptr<Gathered> bins(new Gathered);
    make_bins(*octaves, *bins);
    REQUIRE(octaves->ladder().depth() >= 6);
    for (int level = 0; level < octaves->ladder().depth(); ++level) {
        float power[Octaves::Ladder::kTopLines], blocks, effective;
        octaves->ladder().sums(level, 0, power, &blocks, &effective);
        const double step = turn / 256 / std::exp2(level);
        const int lines = octaves->ladder().lines(level);
        double expected = 0, by_frequency = 0, found = 0, found_by_frequency = 0, weight = 0, counts = 0;
        for (int i = 0; i < lines; ++i) {
            const double w = turn * (45 + i) / 256;
            double passed = 1;
            for (int l = 1; l <= level; ++l) passed *= gain(w / std::exp2(l));
            const double one = std::ldexp(static_cast<double>(power[i]), octaves->exponent(level) + level) /
                               (96 * static_cast<double>(blocks) * passed);
            expected += one;
            by_frequency += step * (45 + i);
            weight += 1;
        }
        for (int i = 0; i < bins->size(); ++i) {
            const double l = static_cast<double>(bins->lam(i)), c = static_cast<double>(bins->counts(i));
            if (l < step * 44.9 || l > step * (45 + lines - 0.9)) continue;
            found += c * static_cast<double>(bins->power(i));
            found_by_frequency += c * l;
            counts += c;
        }
        CAPTURE(level);
        CHECK(found / counts == doctest::Approx(expected / weight).epsilon(2e-4));
        CHECK(found_by_frequency / counts == doctest::Approx(by_frequency / weight).epsilon(1e-5));
    }
}
