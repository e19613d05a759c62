// exp and sin(pi a) without libm and without branches. One source serves float, double and Pack (pack.hpp),
// so the result in a pack is the same as for a single number. Errors are at most 2 units in the last place.
#ifndef FLTEA_PACK_MATH_HPP
#define FLTEA_PACK_MATH_HPP

#include "pack.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Adding kRound, which is 1.5 * 2^(bits of the mantissa), rounds a number to the nearest integer and leaves
// that integer in the low bits of the sum. A shift by kShift moves these bits to the exponent, and a shift by
// kSign moves them to the sign.
template <class R>
struct Layout;
template <>
struct Layout<double> {
    typedef std::uint64_t Bits;
    static constexpr double kRound = 6755399441055744.0;
    static constexpr int kShift = 52;
    static constexpr int kSign = 63;
    // largest |x| for which e^x is computed: e^±708 is finite and normal
    static constexpr double kExpMax = 708;
    // the mantissa of this number ends with zeros, so that its multiples are exact
    static constexpr double kLn2High = 0.69314718055829871;
    static constexpr double kLn2Low = 1.6465949582897082e-12;
};
template <>
struct Layout<float> {
    typedef std::uint32_t Bits;
    static constexpr float kRound = 12582912.0f;
    static constexpr int kShift = 23;
    static constexpr int kSign = 31;
    static constexpr float kExpMax = 87;
    static constexpr float kLn2High = 0.693115234f;
    static constexpr float kLn2Low = 3.19461833e-05f;
};

// Reinterprets the bits of a number as an integer, and back.
template <class R>
inline typename Layout<R>::Bits to_bits(R number) {
    typename Layout<R>::Bits bits;
    std::memcpy(&bits, &number, sizeof bits);
    return bits;
}
template <class R>
inline R from_bits(typename Layout<R>::Bits bits) {
    R number;
    std::memcpy(&number, &bits, sizeof number);
    return number;
}

// Return y * 2^n and y * 2^-n. `rounded` is n + kRound, which has the integer n in its low bits (see kRound
// above). Both results have to be normal numbers.
template <class R>
inline R scale_up(R y, R rounded) {
    return from_bits<R>(to_bits(y) + (to_bits(rounded) << Layout<R>::kShift));
}
template <class R>
inline R scale_down(R y, R rounded) {
    return from_bits<R>(to_bits(y) - (to_bits(rounded) << Layout<R>::kShift));
}
template <class R>
inline R negate_if_odd(R y, R rounded) {
    return from_bits<R>(to_bits(y) ^ (to_bits(rounded) << Layout<R>::kSign));
}
template <int W>
inline Pack<double, W> scale_up(Pack<double, W> y, Pack<double, W> rounded) {
    typedef typename Vectors<W>::Words Words;
    return Pack<double, W>((typename Vectors<W>::Doubles)((Words)y.v + ((Words)rounded.v << 52)));
}
template <int W>
inline Pack<double, W> scale_down(Pack<double, W> y, Pack<double, W> rounded) {
    typedef typename Vectors<W>::Words Words;
    return Pack<double, W>((typename Vectors<W>::Doubles)((Words)y.v - ((Words)rounded.v << 52)));
}
template <int W>
inline Pack<double, W> negate_if_odd(Pack<double, W> y, Pack<double, W> rounded) {
    typedef typename Vectors<W>::Words Words;
    return Pack<double, W>((typename Vectors<W>::Doubles)((Words)y.v ^ ((Words)rounded.v << 63)));
}

// A number and its reciprocal.
template <class T>
struct Powers {
    T up, down;
};

// Computes e^x and e^-x together, which takes little longer than computing one of them. With x = n ln 2 + r,
// the even and odd parts of e^r (cosh r and sinh r) serve both e^x and e^-x. Saturates at e^±708 (float:
// e^±87), so the result is positive and finite for every finite x. NaN gives NaN.
template <class T>
inline Powers<T> exp_both(T x) {
    typedef Real<T> R;
    typedef Layout<R> L;
    x = min(max(x, T(-L::kExpMax)), T(L::kExpMax));
    const T rounded = mul_add(x, T(R(1.4426950408889634)), T(L::kRound));
    const T n = rounded - T(L::kRound);
    const T r = mul_add(n, T(-L::kLn2Low), mul_add(n, T(-L::kLn2High), x));
    const T s = r * r;
    const T ss = s * s;
    // Taylor series of cosh r - 1 and sinh r, |r| <= 0.35. The first omitted terms are below 1e-17, for float
    // below 6e-9. The terms are summed in pairs, so that fewer operations have to wait for each other.
    const T even0 = mul_add(T(R(1.0 / 24)), s, T(R(0.5)));
    const T odd0 = mul_add(T(R(1.0 / 120)), s, T(R(1.0 / 6)));
    T even, odd;
    if (sizeof(R) == sizeof(float)) {
        even = mul_add(T(R(1.0 / 720)), ss, even0) * s;
        odd = mul_add(odd0, s * r, r);
    } else {
        const T even1 = mul_add(T(R(1.0 / 40320)), s, T(R(1.0 / 720)));
        const T even2 = mul_add(T(R(1.0 / 479001600)), s, T(R(1.0 / 3628800)));
        even = mul_add(mul_add(even2, ss, even1), ss, even0) * s;
        const T odd1 = mul_add(T(R(1.0 / 362880)), s, T(R(1.0 / 5040)));
        const T odd2 = mul_add(T(R(1.0 / 6227020800)), s, T(R(1.0 / 39916800)));
        odd = mul_add(mul_add(mul_add(odd2, ss, odd1), ss, odd0), s * r, r);
    }
    Powers<T> powers;
    powers.up = scale_up(T(R(1)) + (even + odd), rounded);
    powers.down = scale_down(T(R(1)) + (even - odd), rounded);
    return powers;
}

template <class T>
inline T exp(T x) {
    return exp_both(x).up;
}

// sin(pi a) for |a| up to 2^51 (float: 2^22), exactly 0 at integers. Larger |a| give a bounded but
// meaningless result.
template <class T>
inline T sin_pi(T a) {
    typedef Real<T> R;
    typedef Layout<R> L;
    const T rounded = a + T(L::kRound);
    // r: difference between a and the nearest integer. If |a| is so large that only integers are
    // floating-point numbers there, r should be 0 but is a rounding error. It is limited to 1/2, because the
    // series holds up to 1/2.
    const T r = max(min(a - (rounded - T(L::kRound)), T(R(0.5))), T(R(-0.5)));
    const T s = r * r;
    // Taylor series in (pi r)^2. Because of |r| <= 1/2, the first omitted term is 1e-18.
    T sum = T(R(5.3926646626081290e-10));
    sum = mul_add(sum, s, T(R(-2.2948428997269873e-08)));
    sum = mul_add(sum, s, T(R(7.9520540014755126e-07)));
    sum = mul_add(sum, s, T(R(-2.1915353447830217e-05)));
    sum = mul_add(sum, s, T(R(4.6630280576761255e-04)));
    sum = mul_add(sum, s, T(R(-7.3704309457143504e-03)));
    sum = mul_add(sum, s, T(R(8.2145886611128233e-02)));
    sum = mul_add(sum, s, T(R(-5.9926452932079211e-01)));
    sum = mul_add(sum, s, T(R(2.5501640398773455)));
    sum = mul_add(sum, s, T(R(-5.1677127800499703)));
    return negate_if_odd(mul_add(r, T(R(3.141592653589793)), r * s * sum), rounded);
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
