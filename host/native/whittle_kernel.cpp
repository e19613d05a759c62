// Computes the spectra of all noise parts and the sums over bins, for one instruction set
// (whittle_kernel.hpp). CMakeLists.txt compiles this file once for each instruction set. It calls no inline
// function of the standard library: the linker would keep only one of its compiled copies, and use this copy
// for all instruction sets.
#include "whittle_kernel.hpp"

#include <math.h>

#include <type_traits>

#include "pack_log.hpp"
#include "set_name.hpp"

namespace fltea {
namespace noise_models {
inline namespace FLTEA_INSTRUCTION_SET {
namespace {

using engine::exp;
using engine::log;
using engine::max;
using engine::min;
using engine::sin_pi;

typedef engine::Pack<double, engine::kWidth> Wide;

template <class T>
T from(const double* at) {
    T found;
    __builtin_memcpy(&found, at, sizeof found);
    return found;
}
template <class T>
void to(double* at, T value) {
    __builtin_memcpy(at, &value, sizeof value);
}

// Calls op(T(), i) for all bins. At first T is a pack, and a call handles as many bins from i on as the pack
// has numbers. For the last few bins T is double, and a call handles one bin. The result for a bin does not
// depend on T (pack_math.hpp). Packs are used explicitly, because compilers do not vectorise exp.
template <class Op>
__attribute__((always_inline)) inline void each(std::size_t size, Op op) {
    std::size_t i = 0;
    for (; i + engine::kWidth <= size; i += engine::kWidth) op(Wide(), i);
    for (; i < size; ++i) op(double(), i);
}

// Computes kSums sums over all bins. `term` computes the terms for a bin. Each sum consists of eight partial
// sums, whatever the width of a pack, so that the result is always the same.
template <int kSums, class Term>
__attribute__((always_inline)) inline void sums_of(std::size_t size, Term term, double* found) {
    constexpr std::size_t kPacks = 8 / engine::kWidth;
    Wide packs[kSums][kPacks];
    for (auto& row : packs)
        for (Wide& one : row) one = Wide(0.0);
    std::size_t i = 0;
    for (; i + 8 <= size; i += 8)
#pragma GCC unroll 8
        for (std::size_t k = 0; k < kPacks; ++k) {
            Wide terms[kSums];
            term(terms, i + k * engine::kWidth);
#pragma GCC unroll 8
            for (int j = 0; j < kSums; ++j) packs[j][k] += terms[j];
        }
    double lane[kSums][8];
    __builtin_memcpy(lane, packs, sizeof lane);
    for (; i < size; ++i) {
        double terms[kSums];
        term(terms, i);
        for (int j = 0; j < kSums; ++j) lane[j][i % 8] += terms[j];
    }
    for (int j = 0; j < kSums; ++j)
        found[j] = ((lane[j][0] + lane[j][4]) + (lane[j][1] + lane[j][5])) +
                   ((lane[j][2] + lane[j][6]) + (lane[j][3] + lane[j][7]));
}

double share_of(double logit) { return 1 / (1 + exp(-logit)); }

// Writes the spectrum of a relaxation. `mirrored`: whether the spectrum is reflected about a quarter of the
// sample rate.
void relaxation(const Columns& b, bool mirrored, const double* eta, double* part, double* const* slope) {
    const double rate = exp(eta[1]), phi = exp(-rate), left = -::expm1(-rate);
    const double gap = -::expm1(-2 * rate), level = exp(eta[0]) * gap, own = 2 * phi / gap;
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T seen = from<T>(b.square + i), square = mirrored ? T(4.0) - seen : seen;
        const T distance = T(left * left) + T(phi) * square;
        const T value = T(level) / distance;
        to(part + i, value);
        to(slope[0] + i, value);
        to(slope[1] + i, value * T(rate) * T(phi) * (T(own) + (square - T(2 * left)) / distance));
    });
}

// Order α and feedback g of a part, and the derivatives of both by the part's first two free parameters.
struct Order {
    double alpha, g, by[2][2];
};

bool order_of(Part part, const Columns& b, const double* eta, Order& o) {
    if (part == kOrder || part == kOrderByQ) {
        const double share = share_of(eta[1]), most = exp(kLn2 * eta[0]);
        o = Order{eta[0], -most * share, {{1, 0}, {-most * share * kLn2, -most * share * (1 - share)}}};
    } else if (part == kOrderByF) {
        const double g = -exp(eta[1]);
        o = Order{eta[0] - g, g, {{1, -g}, {0, g}}};
    } else {
        const double g = -exp(eta[1] + eta[0] * b.log_h);
        o = Order{eta[0], g, {{1, 0}, {g * b.log_h, g}}};
    }
    return o.alpha >= b.lowest_order && o.alpha <= b.highest_order && o.g > -exp(kLn2 * o.alpha) * (1 - 5e-8);
}

bool order(Part which, const Columns& b, const double* eta, double* part, double* const* slope) {
    Order o;
    if (!order_of(which, b, eta, o)) return false;
    const double ln_by_alpha = which == kOrderByQ ? 2 * b.log_h : 0.0;
    const double s2 = exp(eta[2] + ln_by_alpha * o.alpha), alpha = o.alpha, g = o.g;
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T ln_size = from<T>(b.ln_size + i), quarter = from<T>(b.quarter + i);
        const T size = exp(T(alpha) * ln_size);
        const T turn = (T(alpha) * quarter + from<T>(b.lam + i)) / T(kPi);
        const T real = size * sin_pi(turn + T(0.5)), imaginary = size * sin_pi(turn);
        const T distance = max(size * size - T(2 * g) * real + T(g * g), T(1e-200));
        const T value = T(s2) / distance;
        const T by_alpha =
            T(-2.0) * (size * size * ln_size - T(g) * (ln_size * real - quarter * imaginary)) / distance +
            T(ln_by_alpha);
        const T by_g = T(2.0) * (real - T(g)) / distance;
        to(part + i, value);
        to(slope[0] + i, value * (by_alpha * T(o.by[0][0]) + by_g * T(o.by[1][0])));
        to(slope[1] + i, value * (by_alpha * T(o.by[0][1]) + by_g * T(o.by[1][1])));
        to(slope[2] + i, value);
    });
    return true;
}

void arfima(const Columns& b, bool by_step, const double* eta, double* part, double* const* slope) {
    const double rate = exp(eta[1]), phi = exp(-rate), left = -::expm1(-rate);
    const double level = exp(eta[2]) * (by_step ? 1.0 : left * left), by_left = by_step ? 0.0 : 2 / left;
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T ln_size = from<T>(b.ln_size + i), square = from<T>(b.square + i);
        const T distance = T(left * left) + T(phi) * square;
        const T value = T(level) * exp(T(-2 * eta[0]) * ln_size) / distance;
        to(part + i, value);
        to(slope[0] + i, T(-2.0) * ln_size * value);
        to(slope[1] + i, value * T(rate) * T(phi) * (T(by_left) - (T(2 * left) - square) / distance));
        to(slope[2] + i, value);
    });
}

void resonance(const Columns& b, const double* eta, double* part, double* const* slope) {
    const double at = exp(eta[1]), width = at * exp(eta[2]), r = exp(-width), p = exp(eta[0]);
    const double c = ::cos(at), s = ::sin(at), c2 = c * c - s * s, s2 = 2 * s * c;
    const double one = 1 - r, other = 1 - 2 * r * c2 + r * r;
    const double top = p * one * one * other;
    const double top_by_r = -2 / one + (2 * r - 2 * c2) / other, top_by_at = 4 * r * s2 / other;
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T cos1 = from<T>(b.cos1 + i), sin1 = from<T>(b.sin1 + i);
        const T near = cos1 * T(c) + sin1 * T(s), far = cos1 * T(c) - sin1 * T(s);
        const T sin_near = sin1 * T(c) - cos1 * T(s), sin_far = sin1 * T(c) + cos1 * T(s);
        const T d1 = T(1.0) - T(2 * r) * near + T(r * r), d2 = T(1.0) - T(2 * r) * far + T(r * r);
        const T value = T(top) / (d1 * d2);
        const T by_width = -value * T(width) * T(r) *
                           (T(top_by_r) - T(2.0) * (T(r) - near) / d1 - T(2.0) * (T(r) - far) / d2);
        to(part + i, value);
        to(slope[0] + i, value);
        to(slope[2] + i, by_width);
        to(slope[1] + i,
           value * T(at) * (T(top_by_at) + T(2 * r) * (sin_near / d1 - sin_far / d2)) + by_width);
    });
}

// Writes the power gain of a low-pass. It is the sum of three analog gains: at the frequency itself, and at
// the two nearest frequencies that aliasing folds onto it.
void low_pass(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double share = share_of(eta[1]), n = 1 + (kMostPoles - 1) * share;
    const double by_n = (kMostPoles - 1) * share * (1 - share);
    each(b.size, [=](auto kind, std::size_t i) {
        typedef decltype(kind) T;
        T sum = T(0.0), by_c = T(0.0), by_poles = T(0.0);
        for (std::size_t k = 0; k < 3; ++k) {
            const T ratio = from<T>(b.branch + k * b.size + i) - T(eta[0]);
            const T one = T(1.0) / (T(1.0) + exp(min(T(n) * ratio, T(200.0))));
            sum += one;
            by_c += one * (T(1.0) - one);
            by_poles += one * (T(1.0) - one) * ratio;
        }
        to(gain + i, sum);
        to(slope[0] + i, T(n) * by_c / sum);
        to(slope[1] + i, -by_poles / sum * T(by_n));
    });
}

// Writes the power gain of a high-pass. With one pole it is the gain of the digital filter (1 - z) / (1 - a
// z), where z is the delay by one sample. This filter subtracts an exponentially weighted mean from the
// samples.
void high_pass(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double share = share_of(eta[1]), n = 1 + (kMostPoles - 1) * share;
    const double by_n = (kMostPoles - 1) * share * (1 - share);
    each(b.size, [=](auto kind, std::size_t i) {
        typedef decltype(kind) T;
        const T ratio = T(eta[0]) - T(2.0) * from<T>(b.ln_size + i);
        const T passed = T(1.0) / (T(1.0) + exp(min(T(n) * ratio, T(200.0))));
        const T stopped = T(1.0) - passed;
        to(gain + i, passed);
        to(slope[0] + i, T(-n) * stopped);
        to(slope[1] + i, T(-by_n) * ratio * stopped);
    });
}

// Writes the power gain of a notch. It is the gain of the bilinear transform of an analog notch, averaged
// over each bin.
void notch(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double at = exp(eta[0]), centre = ::tan(at / 2), square = centre * centre;
    const double width = centre * exp(eta[1]);
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T sine = from<T>(b.square + i) / T(4.0), cosine = T(1.0) - sine, step = from<T>(b.spread + i);
        const T away = sine - T(square) * cosine, flat = sine * cosine;
        // At a single frequency, the gain is A / (A + K), with A and K as below. It is averaged over the
        // bin's frequencies, whose mean square distance from the bin's centre increases the mean of A by B.
        const T A = away * away, B = flat * T(1 + square) * T(1 + square) * step;
        const T K = T(width * width) * flat, W = A + B + K;
        const T both = T(4.0) * A * B * K / (W * W * W), value = (A + B) / W - both, more = T(3.0) * both / W;
        const T by_A = K / (W * W) - T(4.0) * B * K / (W * W * W) + more;
        const T by_B = K / (W * W) - T(4.0) * A * K / (W * W * W) + more;
        const T by_K = more - (A + B) / (W * W) - T(4.0) * A * B / (W * W * W);
        const T by_square =
            (by_B * T(2.0) * flat * T(1 + square) * step - by_A * T(2.0) * away * cosine) / value;
        const T by_width = by_K * T(2.0) * K / value;
        to(gain + i, value);
        to(slope[0] + i, (by_square * T(2.0) * T(square) + by_width) * T(at) * T(1 + square) / T(2 * centre));
        to(slope[1] + i, by_width);
    });
}

// Returns the power gain of a mean of m samples at the frequency `lam`. It is averaged over a bin, so that it
// is not 0 at the filter's zeros. `step`: mean square distance of the bin's frequencies from its centre.
double mean_gain(double lam, double step, int m) {
    const double sine = ::sin(lam / 2), cosine = ::cos(lam / 2);
    const double above = ::sin(m * lam / 2), ratio = above / (m * sine);
    const double slope = (m * ::cos(m * lam / 2) * sine - above * cosine) / (2 * m * sine * sine);
    return max(ratio * ratio + slope * slope * step, 1e-6);
}

bool term_at(const Columns& b, Term term, const double* eta, double* part, double* const* slope) {
    const std::size_t n = b.size;
    const auto level = [=](const double* shape) {
        const double power = exp(eta[0]);
        each(n, [=](auto one, std::size_t i) {
            typedef decltype(one) T;
            const T value = T(power) * from<T>(shape + i);
            to(part + i, value);
            to(slope[0] + i, value);
        });
    };
    switch (term.part) {
        case kWhite:
        case kFloor: {
            const double power = exp(eta[0]);
            each(n, [=](auto one, std::size_t i) {
                typedef decltype(one) T;
                to(part + i, T(power));
                to(slope[0] + i, T(power));
            });
            return true;
        }
        case kRelaxation:
        case kAlternating:
            relaxation(b, term.part == kAlternating, eta, part, slope);
            return true;
        case kWalk:
            level(b.walk);
            return true;
        case kOrder:
        case kOrderByF:
        case kOrderByf:
        case kOrderByQ:
            return order(term.part, b, eta, part, slope);
        case kArfima:
        case kArfimaByStep:
            arfima(b, term.part == kArfimaByStep, eta, part, slope);
            return true;
        case kResonance:
            resonance(b, eta, part, slope);
            return true;
        case kQuantised:
            level(b.square);
            return true;
        case kRise: {
            const double power = exp(eta[0]);
            each(n, [=](auto one, std::size_t i) {
                typedef decltype(one) T;
                const T ln = T(2.0) * (from<T>(b.ln_size + i) - T(kLn2));
                const T value = T(power) * exp(T(eta[1]) * ln);
                to(part + i, value);
                to(slope[0] + i, value);
                to(slope[1] + i, value * ln);
            });
            return true;
        }
        case kLowPass:
            low_pass(b, eta, part, slope);
            return true;
        case kHighPass:
            high_pass(b, eta, part, slope);
            return true;
        case kSharp:
            each(n, [=](auto one, std::size_t i) {
                typedef decltype(one) T;
                const T square = from<T>(b.square + i), h = T(1.0) + T(eta[0]) * square;
                to(part + i, h * h);
                to(slope[0] + i, T(2.0) * square / h);
            });
            return true;
        case kNotch:
            notch(b, eta, part, slope);
            return true;
        case kMean:
            for (std::size_t i = 0; i < n; ++i) part[i] = mean_gain(b.lam[i], b.spread[i], term.size);
            return true;
    }
    return false;
}

double nll(const Columns& b, const double* total) {
    double found;
    sums_of<1>(
        b.size,
        [=](auto* terms, std::size_t i) {
            typedef typename std::remove_pointer<decltype(terms)>::type T;
            const T here = from<T>(total + i);
            terms[0] = from<T>(b.counts + i) * (log(here) + from<T>(b.power + i) / here);
        },
        &found);
    return found;
}

// Computes up to four sums of products together, because in a single sum each addition would have to wait for
// the previous one.
template <int kSums>
void some_dots(std::size_t size, const double* a, const double* const* rows, double* found) {
    sums_of<kSums>(
        size,
        [=](auto* terms, std::size_t i) {
            typedef typename std::remove_pointer<decltype(terms)>::type T;
            const T one = from<T>(a + i);
#pragma GCC unroll 8
            for (int j = 0; j < kSums; ++j) terms[j] = one * from<T>(rows[j] + i);
        },
        found);
}

void dots(std::size_t size, const double* a, int count, const double* const* rows, double* found) {
    for (; count >= 4; count -= 4, rows += 4, found += 4) some_dots<4>(size, a, rows, found);
    if (count == 3) some_dots<3>(size, a, rows, found);
    if (count == 2) some_dots<2>(size, a, rows, found);
    if (count == 1) some_dots<1>(size, a, rows, found);
}

void times(std::size_t size, const double* a, const double* b, double* into) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(into + i, from<T>(a + i) * from<T>(b + i));
    });
}

void plus(std::size_t size, const double* a, double* into) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(into + i, from<T>(into + i) + from<T>(a + i));
    });
}

void inverted(std::size_t size, double* a, double* inverse) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T here = from<T>(a + i);
        to(inverse + i, T(1.0) / here);
        to(a + i, log(here));
    });
}

void whole(std::size_t size, const double* gain, double* total, double* floor, double* inverse,
           double* over) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T passed = from<T>(total + i) * from<T>(gain + i), all = passed + from<T>(floor + i);
        const T by = T(1.0) / all;
        to(total + i, all);
        to(floor + i, passed / all);
        to(inverse + i, by);
        to(over + i, from<T>(gain + i) * by);
    });
}

void derivatives(const Columns& b, const double* total, int free, const double* const* slopes, double* over,
                 double* gradient, double* information) {
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(over + i, from<T>(b.counts + i) * (T(1.0) - from<T>(b.power + i) / from<T>(total + i)));
    });
    dots(b.size, over, free, slopes, gradient);
    for (int k = 0; k < free; ++k) {
        times(b.size, b.counts, slopes[k], over);
        dots(b.size, over, k + 1, slopes, information + k * kMostFree);
        for (int j = 0; j < k; ++j) information[j * kMostFree + k] = information[k * kMostFree + j];
    }
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

extern const Kernel FLTEA_JOIN(kernel_, FLTEA_INSTRUCTION_SET) = {
    FLTEA_STRING(FLTEA_INSTRUCTION_SET), term_at, nll, whole, derivatives, dots, times, plus, inverted};

}  // namespace noise_models
}  // namespace fltea
