// The logarithm of positive normal numbers, without libm and without branches, for double and Pack
// (pack.hpp). The result for a number is the same in a Pack of any width. The error is at most 2 units in the
// last place.
#pragma once

#include "pack_math.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Splits x into n and m with x = 2^n m, where m is between 1/√2 and √2. `shifted` is 2^52 + 1023 + n: the
// bits of such a double can be made from those of x by integer instructions alone.
template <class T>
struct Binary {
    T shifted, m;
};

inline Binary<double> split(double x) {
    const std::uint64_t bits = to_bits(x) + (std::uint64_t(0x3ff00000 - 0x3fe6a09e) << 32);
    return {from_bits<double>((bits >> 52) | (std::uint64_t(0x433) << 52)),
            from_bits<double>((bits & 0xfffffffffffffULL) + (std::uint64_t(0x3fe6a09e) << 32))};
}
template <int W>
inline Binary<Pack<double, W>> split(Pack<double, W> x) {
    typedef typename Vectors<W>::Words Words;
    typedef typename Vectors<W>::Doubles Doubles;
    const Words bits = (Words)x.v + (std::uint64_t(0x3ff00000 - 0x3fe6a09e) << 32);
    return {Pack<double, W>((Doubles)((bits >> 52) | (std::uint64_t(0x433) << 52))),
            Pack<double, W>((Doubles)((bits & 0xfffffffffffffULL) + (std::uint64_t(0x3fe6a09e) << 32)))};
}

template <class T>
inline T log(T x) {
    typedef Layout<double> L;
    const Binary<T> two = split(x);
    const T n = two.shifted - T(4503599627370496.0 + 1023.0);
    const T f = two.m - T(1.0);
    const T s = f / (two.m + T(1.0));
    const T z = s * s;
    // log m = 2 artanh(s) for s = (m - 1)/(m + 1), as a Taylor series. |s| is at most 0.1716, so the first
    // omitted term is below 1e-17.
    T sum = T(2.0 / 21);
    sum = mul_add(sum, z, T(2.0 / 19));
    sum = mul_add(sum, z, T(2.0 / 17));
    sum = mul_add(sum, z, T(2.0 / 15));
    sum = mul_add(sum, z, T(2.0 / 13));
    sum = mul_add(sum, z, T(2.0 / 11));
    sum = mul_add(sum, z, T(2.0 / 9));
    sum = mul_add(sum, z, T(2.0 / 7));
    sum = mul_add(sum, z, T(2.0 / 5));
    sum = mul_add(sum, z, T(2.0 / 3));
    const T small = mul_add(sum * z, s, T(2.0) * s);
    return mul_add(n, T(L::kLn2High), mul_add(n, T(L::kLn2Low), small));
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
