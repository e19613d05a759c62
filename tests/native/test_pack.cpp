// Tests of SIMD packs, which are compared lane by lane with plain numbers.
#include <doctest/doctest.h>

#include <cmath>
#include <initializer_list>
#include <limits>

#include "pack.hpp"
#include "pack_math.hpp"

namespace {

typedef fltea::engine::Pack<double, fltea::engine::kWidth> Wide;
const double kInf = std::numeric_limits<double>::infinity();
const double kNan = std::numeric_limits<double>::quiet_NaN();
const double kValues[] = {0.0, -0.0, 1.0, -1.5, 1e300, -1e-300, 3.0, 5e-324, kInf, -kInf, kNan};

bool same(double a, double b) {
    return std::memcmp(&a, &b, sizeof a) == 0 || (std::isnan(a) && std::isnan(b));
}

// Returns a pack with one number in its first lane and another number in all other lanes. A lane that uses
// its neighbour's number would be noticed.
Wide wide(double first, double others) {
    Wide pack(others);
    pack.set(0, first);
    return pack;
}

}  // namespace

TEST_CASE("arithmetic, comparisons and choices lane by lane") {
    for (double a : kValues) {
        for (double b : kValues) {
            CAPTURE(a);
            CAPTURE(b);
            const Wide x = wide(a, b), y = wide(b, 2.0);
            CHECK(same((x + y)[0], a + b));
            CHECK(same((x - y)[0], a - b));
            CHECK(same((x * y)[0], a * b));
            CHECK(same((x / y)[0], a / b));
            CHECK(same((-x)[0], -a));
            CHECK(same(abs(x)[0], std::fabs(a)));
            CHECK(same(sqrt(x)[0], std::sqrt(a)));
            CHECK((x < y)[0] == (a < b));
            CHECK((x <= y)[0] == (a <= b));
            CHECK((x > y)[0] == (a > b));
            CHECK((x >= y)[0] == (a >= b));
            CHECK((x == y)[0] == (a == b));
            CHECK((x != y)[0] == (a != b));
            CHECK(same(select(x < y, x, y)[0], a < b ? a : b));
            CHECK(same(min(x, y)[0], fltea::engine::min(a, b)));
            CHECK(same(max(x, y)[0], fltea::engine::max(a, b)));
            CHECK(same(mul_add(x, y, Wide(1.0))[0], fltea::engine::mul_add(a, b, 1.0)));
            CHECK(same((x + y)[fltea::engine::kWidth - 1], b + 2.0));
            CHECK(fltea::engine::is_finite(x)[0] == std::isfinite(a));
            CHECK(fltea::engine::is_finite(a) == std::isfinite(a));
        }
    }
}

TEST_CASE("masks") {
    fltea::engine::Mask<fltea::engine::kWidth> mask = Wide(0.0) != Wide(0.0);
    CHECK_FALSE(any(mask));
    CHECK(all(!mask));
    mask.set(fltea::engine::kWidth - 1, true);
    CHECK(any(mask));
    CHECK_FALSE(all(mask));
    CHECK(mask[fltea::engine::kWidth - 1]);
    CHECK_FALSE((mask & !mask)[fltea::engine::kWidth - 1]);
    CHECK(all(mask | !mask));
    CHECK(fltea::engine::any(true));
    CHECK_FALSE(fltea::engine::all(false));
}

TEST_CASE("a NaN stays one, and saturation is finite") {
    CHECK(std::isnan(fltea::engine::exp(kNan)));
    CHECK(std::isnan(fltea::engine::exp(Wide(kNan))[0]));
    for (double x : {kInf, 1e300, 800.0}) {
        CHECK(fltea::engine::exp(x) == fltea::engine::exp(708.0));
        CHECK(fltea::engine::exp(-x) == fltea::engine::exp(-708.0));
        CHECK(std::isnormal(fltea::engine::exp(-x)));
        CHECK(std::isfinite(fltea::engine::exp(x)));
    }
    for (float x : {1e30f, 100.0f}) {
        CHECK(std::isfinite(fltea::engine::exp(x)));
        CHECK(std::isnormal(fltea::engine::exp(-x)));
    }
    CHECK(fltea::engine::exp(0.0) == 1.0);
}
