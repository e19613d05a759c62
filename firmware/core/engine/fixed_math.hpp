// Fixed-point arithmetic for a processor without floating point that multiplies 32 by 32 bits in one
// instruction. A number is an integer count of a unit such as 2^-30. Shifts of negative numbers are
// arithmetic (gcc, clang).
#ifndef FLTEA_FIXED_MATH_HPP
#define FLTEA_FIXED_MATH_HPP

#include <cstdint>
#include <cstring>

namespace fltea {
namespace engine {
namespace fixed {

// Returns a b / 2^30. So if a is in units of 2^-28, and b in units of 2^-30, the result is in units of 2^-28.
inline std::int32_t product30(std::int32_t a, std::int32_t b) {
    return static_cast<std::int32_t>((static_cast<std::int64_t>(a) * b) >> 30);
}

inline std::int64_t product30(std::int64_t a, std::int32_t b) {
    const std::int32_t high = static_cast<std::int32_t>(a >> 32);
    const std::uint32_t low = static_cast<std::uint32_t>(a);
    const std::int64_t above = static_cast<std::int64_t>(high) * b;
    const std::int64_t below = static_cast<std::int64_t>(low) * b;
    return above * 4 + (below >> 30);
}

// Largest magnitude of a count that from_float() returns.
constexpr std::int32_t kLargest = (1 << 29) - 1;

// Converts x to a count of units of 2^exponent. The count is rounded to the nearest integer, and its
// magnitude is limited to kLargest.
inline std::int32_t from_float(float x, int exponent) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    const int biased = static_cast<int>(bits >> 23 & 255);
    const std::int32_t m = static_cast<std::int32_t>((bits & 0x7FFFFF) | 0x800000);
    const int up = biased - 150 - exponent;
    std::int32_t count = 0;
    if (up >= 6) {
        count = kLargest;
    } else if (up >= 0) {
        count = m << up;
    } else if (up > -25 && biased != 0) {
        count = ((m >> (-up - 1)) + 1) >> 1;
    }
    return bits >> 31 ? -count : count;
}

// Returns `count` times 2^exponent as a float, or 0 if a float cannot represent this number.
inline float to_float(std::int64_t count, int exponent) {
    if (count == 0) return 0;
    std::uint64_t m = static_cast<std::uint64_t>(count < 0 ? -count : count);
    const int places = __builtin_clzll(m);
    m <<= places;
    const int biased = exponent + 63 - places + 127;
    if (biased < 1 || biased > 253) return 0;
    // The highest 24 bits of the count become the mantissa, rounded. If they are all ones and are rounded up,
    // the addition carries into the exponent, which is right.
    const std::uint32_t top = static_cast<std::uint32_t>(m >> 32);
    std::uint32_t bits =
        (static_cast<std::uint32_t>(biased) << 23) - 0x800000 + ((top >> 8) + (top >> 7 & 1));
    if (count < 0) bits |= UINT32_C(0x80000000);
    float x = 0;
    std::memcpy(&x, &bits, sizeof x);
    return x;
}

// A positive number, represented as m 2^n.
struct Power {
    std::int32_t m;  // in units of 2^-30; its value is between 0.7 and 1.42
    int n;
};

// Returns 2^y, where y is in units of 2^-26. The relative error is 1e-8.
inline Power power_of_two(std::int32_t y) {
    static const std::int32_t series[] = {// (ln 2)^k / k!, in 2^-30
                                          16377, 165394, 1431680, 10327387, 59597083, 257941248, 744261118};
    Power power;
    power.n = (y + (1 << 25)) >> 26;
    const std::int32_t f = (y - power.n * (1 << 26)) * 16;
    std::int32_t sum = series[0];
    for (int k = 1; k < 7; ++k) sum = product30(sum, f) + series[k];
    power.m = product30(sum, f) + (1 << 30);
    return power;
}

// Returns sin(pi a) in units of 2^-30, where a is in units of 2^-28. The error is 1e-8. For integers a the
// result is exactly 0.
inline std::int32_t sin_pi(std::int32_t a) {
    static const std::int32_t series[] = {
        // coefficients of the power series of the sine, in units of 2^-28
        125172, -1978485, 22050869, -160863847, 684554447, -1387197337, 843314857};
    const std::int32_t whole = (a + (1 << 27)) >> 28;
    const std::int32_t r = (a - whole * (1 << 28)) * 4;
    const std::int32_t s = product30(r, r);
    std::int32_t sum = series[0];
    for (int k = 1; k < 7; ++k) sum = product30(sum, s) + series[k];
    const std::int32_t sine = static_cast<std::int32_t>((static_cast<std::int64_t>(sum) * r) >> 28);
    return whole % 2 != 0 ? -sine : sine;
}

}  // namespace fixed
}  // namespace engine
}  // namespace fltea

#endif
