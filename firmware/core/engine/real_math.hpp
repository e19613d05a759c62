// Elementary functions for the fits. For double they are the functions of the C++ library. For float they are
// computed here, because the board has no libm.
#ifndef FLTEA_REAL_MATH_HPP
#define FLTEA_REAL_MATH_HPP

#include <cstdint>
#include <cstring>

#include "fixed_math.hpp"
#include "pack_math.hpp"

namespace fltea {
namespace math {

inline double exp(double x) { return __builtin_exp(x); }
inline double exp2(double x) { return __builtin_exp2(x); }
inline double log(double x) { return __builtin_log(x); }
inline double log2(double x) { return __builtin_log2(x); }
inline double log1p(double x) { return __builtin_log1p(x); }
inline double sqrt(double x) { return __builtin_sqrt(x); }
inline double fmod(double x, double y) { return __builtin_fmod(x, y); }
inline double fabs(double x) { return __builtin_fabs(x); }
inline double fmax(double x, double y) { return __builtin_fmax(x, y); }
inline double fmin(double x, double y) { return __builtin_fmin(x, y); }
inline bool finite(double x) { return __builtin_isfinite(x); }

// 2 artanh(s) = log((1 + s) / (1 - s)) for |s| <= 0.172.
inline float log_of_ratio(float s) {
    const float z = s * s;
    const float sum = z * (0.6666666667f + z * (0.4f + z * (0.2857142857f + z * 0.2222222222f)));
    return s * sum + 2.0f * s;
}
// The natural logarithm of a positive normal number. For smaller numbers the result is -87.3.
inline float log(float x) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    if (bits < 0x800000 || bits >= 0x7F800000) return bits == 0x7F800000 ? x : -87.33655f;
    // x = 2^n m, with m between 1/√2 and √2.
    bits += 0x3F800000 - 0x3F3504F3;
    const int n = static_cast<int>(bits >> 23) - 127;
    bits = (bits & 0x7FFFFF) + 0x3F3504F3;
    float m = 0;
    std::memcpy(&m, &bits, sizeof m);
    const float rest = log_of_ratio((m - 1.0f) / (m + 1.0f));
    const float places = static_cast<float>(n);
    return places * 0.693115234f + (places * 3.19461833e-05f + rest);
}
// e^x, computed in integers, which is several times as fast on the board. The result is 0 below the range of
// float, and e^88 above it.
inline float exp2(float x) {
    if (!(x > -126.0f)) return 0.0f;
    if (x > 126.9f) x = 126.9f;
    std::int32_t n = static_cast<std::int32_t>(x);
    const float rest = x - static_cast<float>(n);
    const engine::fixed::Power power =
        engine::fixed::power_of_two(static_cast<std::int32_t>(rest * 67108864.0f));
    return engine::fixed::to_float(power.m, power.n + n - 30);
}
inline float exp(float x) {
    // x = n ln 2 + rest, with an integer n. The product n ln 2 is subtracted in two terms, the first of which
    // is exact, so that the rest keeps its precision.
    const float turns = x * 1.442695041f;
    if (!(turns > -126.0f)) return 0.0f;
    if (turns > 126.9f) return exp2(126.9f);
    const std::int32_t n = static_cast<std::int32_t>(turns);
    const float places = static_cast<float>(n);
    const float rest = (x - places * 0.693115234f) - places * 3.19461833e-05f;
    const engine::fixed::Power power =
        engine::fixed::power_of_two(static_cast<std::int32_t>(rest * (1.442695041f * 67108864.0f)));
    return engine::fixed::to_float(power.m, power.n + n - 30);
}
// sin(pi x) for -2 < x < 2.
inline float sin_pi(float x) {
    return engine::fixed::to_float(engine::fixed::sin_pi(engine::fixed::from_float(x, -28)), -30);
}
inline float log2(float x) { return log(x) * 1.442695041f; }
inline float log1p(float x) { return x < 0.4f && x > -0.29f ? log_of_ratio(x / (2.0f + x)) : log(1.0f + x); }
inline float sqrt(float x) { return engine::soft_sqrt(x); }
// The remainder of x / y, for |x| up to 2^24 y.
inline float fmod(float x, float y) { return x - y * static_cast<float>(static_cast<std::int32_t>(x / y)); }
inline float fabs(float x) { return x < 0 ? -x : x; }
inline float fmax(float x, float y) { return x < y ? y : x; }
inline float fmin(float x, float y) { return y < x ? y : x; }
inline bool finite(float x) { return x - x == 0; }

}  // namespace math
}  // namespace fltea

#endif
