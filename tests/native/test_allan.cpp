// Tests of the running sums for the Allan variance. The results have to equal those by the definition of the
// Allan variance, however the samples are divided into calls. This is also tested with breaks of the record,
// snapshots and forgetting.
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "allan_sums.hpp"

using fltea::AllanSums;
using fltea::allan::Point;

namespace {

std::vector<double> noise(std::size_t n, unsigned long long state = 42) {
    std::vector<double> y(n);
    for (double& one : y) {
        one = 3;
        for (int i = 0; i < 4; ++i) {
            state = state * 6364136223846793005ull + 1442695040888963407ull;
            one += static_cast<double>(state >> 11) / 9007199254740992.0 - 0.5;
        }
    }
    return y;
}

// The sums for the Allan variance by their definition. A term compares the sums of two neighbouring blocks of
// m samples. Terms begin every m/8 samples, or at every sample if m is below 16.
struct Expected {
    double squares, terms;
};
Expected expected(const std::vector<double>& y, std::size_t m) {
    const std::size_t step = m / 8 > 1 ? m / 8 : 1;
    Expected found = {0, 0};
    for (std::size_t begin = 0; begin + 2 * m <= y.size(); begin += step) {
        double apart = 0;
        for (std::size_t k = 0; k < m; ++k) apart += y[begin + m + k] - y[begin + k];
        found.squares += apart * apart;
        found.terms += 1;
    }
    return found;
}

bool same(const AllanSums& one, const AllanSums& other) {
    const std::vector<double> a = one.save(), b = other.save();
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

void check_points(const AllanSums& sums, const std::vector<std::vector<double>>& stretches) {
    const std::vector<Point> points = sums.points();
    for (std::size_t j = 0; j < 20; ++j) {
        Expected all = {0, 0};
        const std::size_t m = std::size_t(1) << j;
        for (const std::vector<double>& stretch : stretches) {
            const Expected part = expected(stretch, m);
            all.squares += part.squares;
            all.terms += part.terms;
        }
        if (all.terms == 0) {
            CHECK(points.size() == j);
            return;
        }
        REQUIRE(points.size() > j);
        CHECK(points[j].factor == static_cast<double>(m));
        CHECK(points[j].terms == doctest::Approx(all.terms));
        const double square = static_cast<double>(m) * static_cast<double>(m);
        CHECK(points[j].avar == doctest::Approx(all.squares / all.terms / (2 * square)).epsilon(1e-9));
    }
}

}  // namespace

TEST_CASE("allan: the definition, at every length") {
    for (std::size_t n : {0, 1, 2, 3, 15, 16, 17, 31, 32, 33, 63, 64, 100, 255, 256, 257, 1000, 4099}) {
        const std::vector<double> y = noise(n);
        AllanSums sums;
        sums.add(y.data(), n);
        CHECK(sums.samples() == static_cast<double>(n));
        check_points(sums, {y});
    }
}

TEST_CASE("allan: breaks") {
    const std::vector<std::size_t> lengths = {1, 40, 7, 300, 16, 0, 1000, 2, 513};
    std::vector<std::vector<double>> stretches;
    AllanSums sums;
    for (std::size_t n : lengths) {
        stretches.push_back(noise(n, 7 + n));
        sums.add(stretches.back().data(), n);
        sums.cut(n);
    }
    check_points(sums, stretches);
}

TEST_CASE("allan: cuts of the calls, looks and snapshots change nothing") {
    const std::vector<double> y = noise(5000);
    AllanSums whole, cut;
    whole.add(y.data(), y.size());
    for (std::size_t at = 0, n = 1; at < y.size(); at += n, n = (n * 7 + 3) % 61) {
        if (at + n > y.size()) n = y.size() - at;
        cut.add(y.data() + at, n);
        cut.points();
        const std::vector<double> saved = cut.save();
        AllanSums restored;
        REQUIRE(restored.load(saved.data(), saved.size()));
        CHECK(same(restored, cut));
        cut = restored;
    }
    CHECK(same(whole, cut));
}

TEST_CASE("allan: merged sums are those of stretches with a break between") {
    const std::vector<double> one = noise(900), other = noise(3001, 5);
    AllanSums sums, more;
    sums.add(one.data(), one.size());
    sums.merge(more);
    CHECK(sums.samples() == 900);
    more.add(other.data(), other.size());
    sums.merge(more);
    CHECK(sums.samples() == 3901);
    check_points(sums, {one, other});
    sums.add(one.data(), one.size());
    check_points(sums, {one, other, one});
    sums.merge(sums);
    check_points(sums, {one, other, one, one, other, one});
}

TEST_CASE("allan: merged sums that forget count the newest samples of both, whatever their lengths") {
    const double memory = 200;
    const std::vector<double> small = noise(900);
    std::vector<double> large = noise(3001, 5);
    for (double& value : large) value *= 10;
    AllanSums sums(memory), more(memory);
    sums.add(small.data(), small.size());
    more.add(large.data(), large.size());
    const double of_small = sums.points()[0].avar, of_large = more.points()[0].avar;
    sums.merge(more);
    // Two series are merged. In each series, the newest difference between neighbouring means has the weight
    // 1. Each older difference has exp(-1 / memory) times the weight of the difference after it.
    const double decay = std::exp(-1 / memory);
    const double weight_small = (1 - std::pow(decay, 899)) / (1 - decay);
    const double weight_large = (1 - std::pow(decay, 3000)) / (1 - decay);
    const double mean = (weight_small * of_small + weight_large * of_large) / (weight_small + weight_large);
    CHECK(sums.points()[0].avar == doctest::Approx(mean).epsilon(1e-9));
}

TEST_CASE("allan: what is older than three time constants is forgotten") {
    const double memory = 1000;
    std::vector<double> y = noise(8000);
    AllanSums sums(memory);
    for (std::size_t k = 0; k < 4000; ++k) y[k] *= 1000;
    sums.add(y.data(), 4000);
    sums.cut();
    sums.add(y.data() + 4000, 3500);
    const std::vector<double> last(y.begin() + 4000, y.begin() + 7500);
    const std::vector<Point> points = sums.points();
    CHECK(points.back().factor == 1024);
    CHECK(sums.span() == 3000);
    const std::vector<double> saved = sums.save();
    // The newest term of the Allan variance has the weight 1, and older ones less. The sum of all weights is
    // the number of samples in one time constant of the memory.
    CHECK(points[0].terms == doctest::Approx(2 * memory).epsilon(0.01));
    AllanSums restored(memory);
    CHECK(restored.load(saved.data(), saved.size()));
    // After a gap that is longer than the memory, nothing is left of the sums.
    sums.cut(1e6);
    CHECK(sums.points().empty());
    AllanSums forgetful(50), fresh(50);
    forgetful.add(y.data(), 4000);
    forgetful.cut(1e5);
    forgetful.add(y.data() + 4000, 200);
    fresh.add(y.data() + 4000, 200);
    REQUIRE(forgetful.points().size() == fresh.points().size());
    for (std::size_t i = 0; i < fresh.points().size(); ++i) {
        CHECK(forgetful.points()[i].avar == fresh.points()[i].avar);
    }
    // If sums fade over a long gap again and again, they may reach 0. The result must not be 0 / 0 then.
    const AllanSums other(forgetful);
    for (int i = 0; i < 40; ++i) {
        forgetful.cut(1e4);
        forgetful.merge(fresh);
    }
    for (const Point& point : forgetful.points()) CHECK(std::isfinite(point.avar));
}

TEST_CASE("allan: a snapshot that cannot be one is refused") {
    const std::vector<double> y = noise(700);
    AllanSums sums, untouched;
    sums.add(y.data(), y.size());
    const std::vector<double> good = sums.save();
    untouched.add(y.data(), 10);
    const AllanSums before(untouched);
    const double bad[] = {-1, 0.5, 1e300, std::numeric_limits<double>::quiet_NaN(),
                          std::numeric_limits<double>::infinity()};
    for (std::size_t size = 0; size < good.size() + 3; ++size) {
        if (size == good.size()) continue;
        std::vector<double> other = good;
        other.resize(size);
        CHECK_FALSE(untouched.load(other.data(), size));
    }
    for (std::size_t at = 0; at < good.size(); ++at) {
        for (double number : bad) {
            std::vector<double> other = good;
            other[at] = number;
            // Some of these random states are valid. If a state is accepted, its results must stay finite,
            // and no access may go beyond the memory.
            AllanSums taken;
            if (!taken.load(other.data(), other.size())) continue;
            CHECK(std::isfinite(number));
            taken.add(y.data(), y.size());
            for (const Point& point : taken.points()) CHECK(std::isfinite(point.avar));
        }
    }
    for (std::size_t at : {0, 1, 2}) {
        for (double number : bad) {
            std::vector<double> other = good;
            other[at] = number;
            CHECK_FALSE(untouched.load(other.data(), other.size()));
        }
    }
    CHECK(same(untouched, before));
}

TEST_CASE("allan: a constant axis, an offset, and the largest numbers") {
    std::vector<double> y(5000, 0.1);
    AllanSums sums, plain, shifted, large;
    sums.add(y.data(), y.size());
    for (const Point& point : sums.points()) CHECK(point.avar == 0);
    const std::vector<double> n = noise(5000);
    std::vector<double> far(n), huge(5000);
    for (std::size_t k = 0; k < n.size(); ++k) {
        far[k] += 1e6;
        huge[k] = k % 2 ? 1e100 : -1e100;
    }
    plain.add(n.data(), n.size());
    shifted.add(far.data(), far.size());
    for (std::size_t i = 0; i < plain.points().size(); ++i) {
        CHECK(shifted.points()[i].avar == doctest::Approx(plain.points()[i].avar).epsilon(1e-6));
    }
    large.add(huge.data(), huge.size());
    for (const Point& point : large.points()) CHECK(std::isfinite(point.avar));
    const std::vector<double> saved = large.save();
    CHECK(sums.load(saved.data(), saved.size()));
}
