// Tests of the code by which the device computes in integers instead of floating point: fixed_math.hpp,
// soft_sqrt.hpp, memory_fixed.hpp.
#include <doctest/doctest.h>
#include <stdlib.h>

#include <cmath>
#include <initializer_list>
#include <limits>
#include <vector>

#include "memory_direct.hpp"
#include "memory_fixed.hpp"
#include "soft_sqrt.hpp"

namespace {

using fltea::engine::DirectMemory;
using fltea::engine::FixedMemory;
using fltea::engine::soft_sqrt;
namespace fixed = fltea::engine::fixed;
__extension__ typedef __int128 Wide;

// Pseudo-random bits, the same in each run.
class Random {
  public:
    std::uint64_t operator()() {
        state_ ^= state_ << 13;
        state_ ^= state_ >> 7;
        state_ ^= state_ << 17;
        return state_;
    }

  private:
    std::uint64_t state_ = 88172645463325252u;
};

float float_of(std::uint32_t bits) {
    float x;
    std::memcpy(&x, &bits, sizeof x);
    return x;
}
std::uint32_t bits_of(float x) {
    std::uint32_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return bits;
}

// Returns the weights c_j(a) of past states for the order a and j = 1 .. n, computed in long double by their
// recurrence.
std::vector<long double> weights(long double a, std::size_t n) {
    std::vector<long double> c(n + 1, 1);
    for (std::size_t j = 1; j <= n; ++j) {
        c[j] = c[j - 1] * (static_cast<long double>(j) - 1 - a) / static_cast<long double>(j);
    }
    return c;
}

double sum_of(const FixedMemory& memory, float order) {
    const float at[1] = {order};
    float S[1];
    memory.state_sums(at, S);
    return static_cast<double>(S[0]);
}

const float kOrders[] = {-0.5f, -0.4f, -0.1f, 0.03f, 0.2f, 0.5f,  0.77f, 0.99f,
                         1.01f, 1.3f,  1.5f,  1.9f,  2.1f, 2.25f, 2.5f};

}  // namespace

TEST_CASE("fixed: products in 2^-30 are those of 128 bits, rounded down") {
    Random random;
    for (int i = 0; i < 200000; ++i) {
        // Products of numbers of every size are tested. A product of two 31-bit numbers exceeds 32 bits only
        // if both are near their maximum.
        const std::int32_t a = static_cast<std::int32_t>(random()) >> (1 + random() % 30);
        const std::int32_t b = static_cast<std::int32_t>(random()) >> (1 + random() % 30);
        REQUIRE(fixed::product30(a, b) == static_cast<std::int64_t>((static_cast<Wide>(a) * b) >> 30));
        const std::int64_t wide = static_cast<std::int64_t>(random()) >> (2 + random() % 60);
        REQUIRE(fixed::product30(wide, b) == static_cast<std::int64_t>((static_cast<Wide>(wide) * b) >> 30));
    }
}

TEST_CASE(
    "fixed: from float is the nearest count, to float the nearest float, and what is too large its limit") {
    Random random;
    for (int i = 0; i < 300000; ++i) {
        const float x = float_of(static_cast<std::uint32_t>(random()));
        if (!(std::fabs(x) <= std::numeric_limits<float>::max())) continue;
        const int exponent = static_cast<int>(random() % 120) - 60;
        const double counts = std::ldexp(static_cast<double>(x), -exponent);
        const std::int32_t count = fixed::from_float(x, exponent);
        if (std::fabs(counts) > fixed::kLargest) {
            // A number that is too large gives the largest count, 2^29 - 1, or by rounding one more.
            REQUIRE(std::abs(count) >= fixed::kLargest);
            REQUIRE(std::abs(count) <= fixed::kLargest + 1);
            REQUIRE((count < 0) == (counts < 0));
        } else {
            REQUIRE(std::fabs(count - counts) <= 0.5);
        }
    }
    for (int i = 0; i < 300000; ++i) {
        const std::int64_t count = static_cast<std::int64_t>(random()) >> (1 + random() % 63);
        const int exponent = static_cast<int>(random() % 120) - 60;
        const float expected =
            // this expected result is inexact if `count` has more bits than the 53 of a double
            static_cast<float>(std::ldexp(static_cast<double>(count), exponent));
        const float found = fixed::to_float(count, exponent);
        if (count > -(INT64_C(1) << 53) && count < INT64_C(1) << 53) {
            // A number half way between two floats may be rounded up, while the expected result is the even
            // one of the two floats. Both are equally far from the exact value, so the distances from the
            // exact value are compared and not the results.
            REQUIRE(std::fabs(found - std::ldexp(static_cast<double>(count), exponent)) <=
                    std::fabs(expected - std::ldexp(static_cast<double>(count), exponent)));
        } else {
            REQUIRE(std::fabs(found / expected - 1) <= 1.2e-7f);
        }
        if (std::fabs(count) < fixed::kLargest && std::fabs(count) < 1 << 24) {
            REQUIRE(fixed::from_float(found, exponent) == count);
        }
    }
    CHECK(fixed::from_float(0.0f, -20) == 0);
    CHECK(fixed::from_float(-0.0f, -20) == 0);
    CHECK(fixed::from_float(1e-45f, -149) == 0);
    CHECK(fixed::from_float(std::numeric_limits<float>::max(), -60) == fixed::kLargest);
    CHECK(fixed::from_float(-std::numeric_limits<float>::infinity(), 0) == -fixed::kLargest);
    CHECK(fixed::to_float(1, -140) == 0);
    CHECK(fixed::to_float(0, 3) == 0);
    CHECK(fixed::to_float(INT64_MIN + 1, -63) == -1.0f);
}

TEST_CASE("fixed: powers of two and sines of a half turn to 1e-8, and the sine of a whole one is 0") {
    double worst = 0;
    for (std::int64_t y = -(INT64_C(9) << 26); y < INT64_C(9) << 26; y += 4999) {
        const fixed::Power power = fixed::power_of_two(static_cast<std::int32_t>(y));
        const double found = std::ldexp(static_cast<double>(power.m), power.n - 30);
        worst = std::max(worst, std::fabs(found / std::exp2(std::ldexp(static_cast<double>(y), -26)) - 1));
        REQUIRE(power.m > 0.7 * (1 << 30));
        REQUIRE(power.m < 1.42 * (1 << 30));
    }
    CHECK(worst < 1e-8);
    worst = 0;
    // The filters only use orders from -1/2 to 5/2.
    for (std::int64_t a = -(INT64_C(1) << 27); a <= INT64_C(5) << 27; a += 2999) {
        const double expected = std::sin(3.14159265358979324 * std::ldexp(static_cast<double>(a), -28));
        const double found =
            std::ldexp(static_cast<double>(fixed::sin_pi(static_cast<std::int32_t>(a))), -30);
        worst = std::max(worst, std::fabs(found - expected));
    }
    CHECK(worst < 1e-8);
    for (int whole = -2; whole <= 3; ++whole) CHECK(fixed::sin_pi(whole * (1 << 28)) == 0);
}

TEST_CASE("soft square root: that of IEEE 754, to the bit") {
    Random random;
    for (int i = 0; i < 400000; ++i) {
        const float a = float_of(static_cast<std::uint32_t>(random() % 0x7F000000) + 0x800000);
        REQUIRE(bits_of(soft_sqrt(a)) == bits_of(std::sqrt(a)));
    }
    // All floats near powers of two are tested, at even and odd exponents. Rounding of roots is hardest to
    // get right there, near the squares of floats.
    for (std::uint32_t bits : {0x3F800000u, 0x3F000000u, 0x40000000u, 0x7F000000u, 0x01000000u}) {
        for (std::uint32_t i = 0; i < 4096; ++i) {
            REQUIRE(bits_of(soft_sqrt(float_of(bits - 2048 + i))) ==
                    bits_of(std::sqrt(float_of(bits - 2048 + i))));
        }
    }
    for (int i = 0; i < 100000; ++i) {
        const float root = float_of(0x3F800000 + static_cast<std::uint32_t>(random() % 0x800000));
        for (int ulp = -1; ulp <= 1; ++ulp) {
            const float a = float_of(bits_of(root * root) + static_cast<std::uint32_t>(ulp));
            REQUIRE(bits_of(soft_sqrt(a)) == bits_of(std::sqrt(a)));
        }
    }
    const float infinite = std::numeric_limits<float>::infinity(), least = std::numeric_limits<float>::min();
    CHECK(soft_sqrt(least) == std::sqrt(least));
    CHECK(soft_sqrt(std::numeric_limits<float>::max()) == std::sqrt(std::numeric_limits<float>::max()));
    CHECK(soft_sqrt(infinite) == infinite);
    CHECK(std::isnan(soft_sqrt(std::nanf(""))));
    for (float none : {0.0f, -0.0f, least / 2, 1e-45f, -1.0f, -infinite})
        CHECK(bits_of(soft_sqrt(none)) == 0);
}

// The fixed-point memory multiplies each past state by a weight. tools/gen_fixed_nodes.py chooses the
// memory's constants so that the weights have relative errors below 1e-3 for orders from about 0 to 2. For
// other orders, the errors are larger: up to 1.8e-3 at the order -0.5, and 4.5e-3 at 2.5. An error of less
// than 1e-8 is always allowed.
TEST_CASE("fixed memory: the weights to a thousandth, at ages up to 100,000") {
    const std::size_t ages[] = {1,  2,  3,   4,   5,    6,    7,     8,     10,    14,
                                20, 50, 100, 300, 1000, 3000, 10000, 30000, 100000};
    // nearly the largest state, which is 2^9, so that the result has many digits
    const float pulse = 400;
    std::vector<std::vector<long double>> c;
    for (float order : kOrders) c.push_back(weights(static_cast<long double>(order), 100000));
    FixedMemory memory(1.0f);
    memory.push(pulse, 1);
    std::size_t age = 1;
    for (std::size_t at : ages) {
        for (; age < at; ++age) memory.push(0, 1);
        for (std::size_t i = 0; i < c.size(); ++i) {
            const float order = kOrders[i];
            const double expected = static_cast<double>(c[i][at]);
            const double error = std::fabs(sum_of(memory, order) / static_cast<double>(pulse) - expected);
            const double share = at <= 5                          ? 1e-7
                                 : order >= -0.1f && order < 2.0f ? 1e-3
                                 : order < 2.0f                   ? 2.5e-3
                                                                  : 6e-3;
            CAPTURE(order);
            CAPTURE(at);
            CHECK(error <= share * std::fabs(expected) + 1e-8);
        }
    }
}

TEST_CASE("fixed memory: sums of noise as those of the exact memory, for x, and P that hardly changes") {
    for (float R : {1e-5f, 0.0235f, 1.7f}) {
        FixedMemory memory(R);
        const std::size_t n = 3000;
        std::vector<double> storage(DirectMemory<double>::storage(n));
        DirectMemory<double> direct(storage.data(), n);
        Random random;
        const double sigma = std::sqrt(static_cast<double>(R));
        double worst = 0;
        for (std::size_t k = 0; k < n; ++k) {
            const float x = static_cast<float>(
                sigma * (static_cast<double>(random() >> 11) / 4503599627370496.0 - 1) * 2);
            const float P = R * (0.5f + 0.001f * static_cast<float>(random() % 10));
            memory.push(x, P);
            direct.push(static_cast<double>(x), static_cast<double>(P));
            if (k % 100 != 99) continue;
            for (float order : kOrders) {
                float S, V;
                double exact_S, exact_V;
                memory.sums(order, S, V);
                direct.sums(static_cast<double>(order), exact_S, exact_V);
                CHECK(static_cast<double>(S) == sum_of(memory, order));
                worst = std::max(worst, std::fabs(static_cast<double>(S) - exact_S) / sigma);
                // V is the sum of the variances of all past states, each times the square of its weight. The
                // memory computes V as if infinitely many states had come before, so only V after the last
                // sample is compared. For orders below -1/4, the memory takes the weights of the order -1/4,
                // so V is not compared.
                if (k != n - 1 || order < -0.25f) continue;
                CHECK(std::fabs(static_cast<double>(V) - exact_V) <=
                      5e-3 * exact_V + 2e-6 * static_cast<double>(R));
            }
        }
        CHECK(worst < 3e-4);
    }
}

TEST_CASE("fixed memory: orders out of range are the nearest inside") {
    FixedMemory memory(1.0f);
    for (int k = 0; k < 300; ++k) memory.push(std::sin(static_cast<float>(k)), 1);
    for (float below : {-0.51f, -7.0f, -1e30f}) CHECK(sum_of(memory, below) == sum_of(memory, -0.5f));
    for (float above : {2.51f, 7.0f, 1e30f}) CHECK(sum_of(memory, above) == sum_of(memory, 2.5f));
}

TEST_CASE(
    "fixed memory: what is larger than its largest count is that, and nothing overflows in three hours") {
    for (float R : {1e-6f, 0.9f, 1.0f, 1.9f, 2.0f, 3.9f, 1e6f}) {
        const float unit = std::ldexp(1.0f, static_cast<int>(std::floor(std::ilogb(R) / 2.0))),
                    most = 512 * unit;
        FixedMemory cut(R), whole(R);
        for (int k = 0; k < 100; ++k) {
            cut.push(k % 3 == 0 ? 1e30f : most / 2, 1e30f);
            whole.push(k % 3 == 0 ? most : most / 2, 1e30f);
        }
        for (float order : kOrders) {
            CHECK(sum_of(cut, order) == doctest::Approx(sum_of(whole, order)).epsilon(1e-6));
            float S, V;
            cut.sums(order, S, V);
            CHECK(V >= 0);
            CHECK(V <= 4e31f);
        }
    }
    // The largest numbers are added a million times. The sanitizer would detect an overflow in the sums.
    FixedMemory full(1.0f);
    for (int k = 0; k < 1000000; ++k) full.push(1e9f, 1e9f);
    for (float order : kOrders) {
        float S, V;
        full.sums(order, S, V);
        CHECK(S - S == 0);
        CHECK(V - V == 0);
    }
}

TEST_CASE("fixed memory: an offset does not drift") {
    FixedMemory memory(1.0f);
    for (int k = 0; k < 50000; ++k) memory.push(5, 1);
    for (float order : {0.1f, 0.5f, 1.3f}) {
        const std::vector<long double> c = weights(static_cast<long double>(order), 50000);
        long double sum = 0;
        for (std::size_t j = 1; j <= 50000; ++j) sum += 5 * c[j];
        CHECK(sum_of(memory, order) == doctest::Approx(static_cast<double>(sum)).epsilon(1e-3));
    }
}

TEST_CASE("fixed memory: after reset() or clear() it is a new one") {
    for (bool by_clear : {false, true}) {
        FixedMemory used(0.5f), fresh(0.5f);
        for (int k = 0; k < 1000; ++k) used.push(static_cast<float>(k % 17) - 4, 1);
        used.clear(false);
        CHECK(sum_of(used, 0.3f) != 0);
        if (by_clear) {
            used.clear(true);
        } else {
            used.reset();
        }
        CHECK(sum_of(used, 0.3f) == 0);
        for (int k = 0; k < 40; ++k) {
            used.push(std::sin(static_cast<float>(k)), 0.2f);
            fresh.push(std::sin(static_cast<float>(k)), 0.2f);
            for (float order : kOrders) {
                float S, V, fresh_S, fresh_V;
                used.sums(order, S, V);
                fresh.sums(order, fresh_S, fresh_V);
                CHECK(S == fresh_S);
                CHECK(V == fresh_V);
            }
        }
    }
}
