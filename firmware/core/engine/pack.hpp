// The number types of the estimator's templates: float, double, or Pack<double, W>, which is W doubles in one
// vector register. Each of these doubles is a lane and belongs to another axis. Every operation works on each
// lane separately and without branches, so a lane's result depends neither on its neighbours nor on W. The
// free functions below exist for all three types, so one source of the estimator serves all three.
//
// Rounding: compile with -ffp-contract=off. Products and sums are fused only where the source says mul_add(),
// which rounds once if the instruction set has a fused operation and twice otherwise. This is the only
// difference between the results of different instruction sets. With one instruction set, two uses of the
// same code never differ.
//
// The code is compiled once per instruction set, and all versions are linked together. Everything is
// therefore in an inline namespace named after the instruction set. Otherwise the linker would keep only one
// copy of each inline function, and the version for old processors could contain AVX-512 instructions.
#ifndef FLTEA_PACK_HPP
#define FLTEA_PACK_HPP

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "instruction_set.hpp"
#include "soft_sqrt.hpp"

// Arduino.h defines these macros, which would replace the functions of the same names below.
#undef abs
#undef max
#undef min

#if defined(__AVX2__) && defined(__FMA__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Number of doubles in one register of this instruction set. Wider vectors would compile to much slower code.
#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__FMA__)
constexpr int kWidth = 8;
#elif defined(__AVX2__) && defined(__FMA__)
constexpr int kWidth = 4;
#else
constexpr int kWidth = 2;
#endif

template <class R, int W>
struct Pack;

// For a number type T: the type of one lane, and the number of lanes.
template <class T>
struct Lanes {
    typedef T Real;
    static constexpr int count = 1;
};
template <class R, int W>
struct Lanes<Pack<R, W>> {
    typedef R Real;
    static constexpr int count = W;
};
template <class T>
using Real = typename Lanes<T>::Real;

// The compiler's vector types. There is one struct for each width, because gcc drops attributes that depend
// on a template parameter. `Bits` holds the results of comparisons. `Words` holds integers for arithmetic,
// which are unsigned because overflow of unsigned integers is defined. The vector types need may_alias,
// because the same storage is accessed as packs and as single numbers.
template <int W>
struct Vectors;
template <>
struct Vectors<2> {
    typedef double Doubles __attribute__((vector_size(16), may_alias));
    typedef std::int64_t Bits __attribute__((vector_size(16), may_alias));
    typedef std::uint64_t Words __attribute__((vector_size(16), may_alias));
};
template <>
struct Vectors<4> {
    typedef double Doubles __attribute__((vector_size(32), may_alias));
    typedef std::int64_t Bits __attribute__((vector_size(32), may_alias));
    typedef std::uint64_t Words __attribute__((vector_size(32), may_alias));
};
template <>
struct Vectors<8> {
    typedef double Doubles __attribute__((vector_size(64), may_alias));
    typedef std::int64_t Bits __attribute__((vector_size(64), may_alias));
    typedef std::uint64_t Words __attribute__((vector_size(64), may_alias));
};

// One truth value per lane: all bits of the lane are set, or none. For plain numbers, bool is used instead.
template <int W>
struct Mask {
    typedef typename Vectors<W>::Bits Bits;
    Bits bits;

    friend Mask operator&(Mask a, Mask b) { return Mask{a.bits & b.bits}; }
    friend Mask operator|(Mask a, Mask b) { return Mask{a.bits | b.bits}; }
    friend Mask operator!(Mask a) { return Mask{~a.bits}; }
    bool operator[](int lane) const { return bits[lane] != 0; }
    void set(int lane, bool value) { bits[lane] = value ? -1 : 0; }
};

template <int W>
struct Pack<double, W> {
    static_assert(W >= 2 && W <= kWidth, "a pack is at most as wide as the hardware's registers");
    typedef typename Vectors<W>::Doubles Vector;
    typedef typename Vectors<W>::Bits Bits;
    Vector v;

    Pack() = default;
    // this conversion is implicit, so that constants can be written as in formulas
    Pack(double all) : v(all - Vector{}) {}
    explicit Pack(Vector vector) : v(vector) {}

    double operator[](int lane) const { return v[lane]; }
    void set(int lane, double value) { v[lane] = value; }

    friend Pack operator+(Pack a, Pack b) { return Pack(a.v + b.v); }
    friend Pack operator-(Pack a, Pack b) { return Pack(a.v - b.v); }
    friend Pack operator*(Pack a, Pack b) { return Pack(a.v * b.v); }
    friend Pack operator/(Pack a, Pack b) { return Pack(a.v / b.v); }
    friend Pack operator-(Pack a) { return Pack(-a.v); }
    Pack& operator+=(Pack b) { return *this = *this + b; }
    Pack& operator-=(Pack b) { return *this = *this - b; }
    Pack& operator*=(Pack b) { return *this = *this * b; }

    friend Mask<W> operator<(Pack a, Pack b) { return Mask<W>{(Bits)(a.v < b.v)}; }
    friend Mask<W> operator<=(Pack a, Pack b) { return Mask<W>{(Bits)(a.v <= b.v)}; }
    friend Mask<W> operator>(Pack a, Pack b) { return Mask<W>{(Bits)(a.v > b.v)}; }
    friend Mask<W> operator>=(Pack a, Pack b) { return Mask<W>{(Bits)(a.v >= b.v)}; }
    friend Mask<W> operator==(Pack a, Pack b) { return Mask<W>{(Bits)(a.v == b.v)}; }
    friend Mask<W> operator!=(Pack a, Pack b) { return Mask<W>{(Bits)(a.v != b.v)}; }

    // These friends are found by argument-dependent lookup if one argument is a pack. Constants among the
    // other arguments are then converted to packs.
    friend Pack select(Mask<W> mask, Pack yes, Pack no) { return Pack(mask.bits ? yes.v : no.v); }
    friend Pack min(Pack a, Pack b) { return select(b < a, b, a); }
    friend Pack max(Pack a, Pack b) { return select(a < b, b, a); }
    friend Pack abs(Pack a) { return Pack((Vector)((Bits)a.v & INT64_MAX)); }
    friend Pack sqrt(Pack a) { return Pack(root(a.v)); }
    friend Pack mul_add(Pack a, Pack b, Pack c) { return Pack(fused(a.v, b.v, c.v)); }

  private:
    // Of the overloads of root() and fused(), the one for the vector type of this width is chosen.
#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__FMA__)
    // _mm512_sqrt_pd causes a warning in gcc 12
    static __m512d root(__m512d a) { return _mm512_maskz_sqrt_pd(0xff, a); }
    static __m512d fused(__m512d a, __m512d b, __m512d c) { return _mm512_fmadd_pd(a, b, c); }
#endif
#if defined(__AVX2__) && defined(__FMA__)
    static __m256d root(__m256d a) { return _mm256_sqrt_pd(a); }
    static __m256d fused(__m256d a, __m256d b, __m256d c) { return _mm256_fmadd_pd(a, b, c); }
    static __m128d root(__m128d a) { return _mm_sqrt_pd(a); }
    static __m128d fused(__m128d a, __m128d b, __m128d c) { return _mm_fmadd_pd(a, b, c); }
#elif defined(__SSE2__)
    static __m128d root(__m128d a) { return _mm_sqrt_pd(a); }
    static __m128d fused(__m128d a, __m128d b, __m128d c) { return a * b + c; }
#elif defined(__aarch64__)
    static Vector root(Vector a) { return (Vector)vsqrtq_f64((float64x2_t)a); }
    static Vector fused(Vector a, Vector b, Vector c) {
        return (Vector)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
    }
#else
    static Vector root(Vector a) { return Vector{__builtin_sqrt(a[0]), __builtin_sqrt(a[1])}; }
    static Vector fused(Vector a, Vector b, Vector c) { return a * b + c; }
#endif
};

// The same functions for plain numbers. They are overloads instead of templates, so that arguments of
// different types are converted as in a formula.
inline double select(bool mask, double yes, double no) { return mask ? yes : no; }
inline float select(bool mask, float yes, float no) { return mask ? yes : no; }
inline double min(double a, double b) { return b < a ? b : a; }
inline float min(float a, float b) { return b < a ? b : a; }
inline double max(double a, double b) { return a < b ? b : a; }
inline float max(float a, float b) { return a < b ? b : a; }
inline double abs(double a) { return __builtin_fabs(a); }
inline float abs(float a) { return __builtin_fabsf(a); }
inline double sqrt(double a) { return __builtin_sqrt(a); }
#if defined(__SOFTFP__)
inline float sqrt(float a) { return soft_sqrt(a); }
#else
inline float sqrt(float a) { return __builtin_sqrtf(a); }
#endif
#if defined(__FP_FAST_FMA)
inline double mul_add(double a, double b, double c) { return __builtin_fma(a, b, c); }
#else
inline double mul_add(double a, double b, double c) { return a * b + c; }
#endif
#if defined(__FP_FAST_FMAF)
inline float mul_add(float a, float b, float c) { return __builtin_fmaf(a, b, c); }
#else
inline float mul_add(float a, float b, float c) { return a * b + c; }
#endif

template <int W>
inline bool any(Mask<W> mask) {
    for (int lane = 0; lane < W; ++lane) {
        if (mask[lane]) return true;
    }
    return false;
}
inline bool any(bool mask) { return mask; }
template <class M>
inline bool all(M mask) {
    return !any(!mask);
}

// The type that a comparison of two numbers of type T returns.
template <class T>
struct MaskOfType {
    typedef bool Type;
};
template <int W>
struct MaskOfType<Pack<double, W>> {
    typedef Mask<W> Type;
};
template <class T>
using MaskOf = typename MaskOfType<T>::Type;

// Reads or writes the number in one lane. A plain number counts as one lane.
template <class T>
inline Real<T> get_lane(T number, int lane) {
    return number[lane];
}
inline double get_lane(double number, int) { return number; }
inline float get_lane(float number, int) { return number; }
template <class T>
inline void set_lane(T& number, int lane, Real<T> value) {
    number.set(lane, value);
}
inline void set_lane(double& number, int, double value) { number = value; }
inline void set_lane(float& number, int, float value) { number = value; }

// Whether the number in each lane is finite, which means neither infinite nor NaN.
template <class T>
inline MaskOf<T> is_finite(T a) {
    return abs(a) <= T(sizeof(Real<T>) == 8 ? Real<T>(__DBL_MAX__) : Real<T>(__FLT_MAX__));
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
