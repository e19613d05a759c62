// The square root of a float, computed in integers and rounded to nearest as IEEE 754 requires. It is meant
// for a processor without floating point, where libm may be slow or missing.
#ifndef FLTEA_SOFT_SQRT_HPP
#define FLTEA_SOFT_SQRT_HPP

#include <cstdint>
#include <cstring>

namespace fltea {
namespace engine {

// The square root of x. Returns 0 for negative numbers and for numbers below the smallest normal float.
inline float soft_sqrt(float a) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &a, sizeof bits);
    if (bits < 0x800000 || bits >= 0x80000000) return 0.0f;
    if (bits >= 0x7F800000) return a;
    const int exponent = static_cast<int>(bits >> 23) - 127, odd = exponent & 1;
    // Computes the root of a 50-bit number bit by bit. The last bit of the root decides the rounding.
    std::uint32_t rest = ((bits & 0x7FFFFF) | 0x800000) << (odd + 1);
    std::uint32_t root = 0, sum = 0;
    for (std::uint32_t bit = 1u << 24; bit != 0; bit >>= 1) {
        const std::uint32_t trial = sum + bit;
        if (trial <= rest) {
            sum = trial + bit;
            rest -= trial;
            root += bit;
        }
        rest <<= 1;
    }
    // The root is never half way between two floats, because the square of such a number has more bits than a
    // float.
    root = (root + 1) >> 1;
    bits = root + (static_cast<std::uint32_t>((exponent - odd) / 2 + 126) << 23);
    std::memcpy(&a, &bits, sizeof a);
    return a;
}

}  // namespace engine
}  // namespace fltea

#endif
