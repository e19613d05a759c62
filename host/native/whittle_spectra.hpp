// The spectra of all noise parts and the gains of all filters, with their derivatives (Kernel::term), for one
// instruction set (whittle_kernel.cpp).
#pragma once

#include <math.h>

#include "bin_loops.hpp"
#include "whittle_kernel.hpp"

namespace fltea {
namespace noise_models {
inline namespace FLTEA_INSTRUCTION_SET {

using engine::exp;
using engine::max;
using engine::min;
using engine::sin_pi;

inline double share_of(double logit) { return 1 / (1 + exp(-logit)); }

// Writes the spectrum of white noise.
inline void white(const Columns& b, const double* eta, double* part, double* const* slope) {
    const double power = exp(eta[0]);
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(part + i, T(power));
        to(slope[0] + i, T(power));
    });
}

// Writes the spectrum exp(eta[0]) · `shape`, where exp(eta[0]) is the power of the part.
inline void scaled(const Columns& b, const double* shape, const double* eta, double* part,
                   double* const* slope) {
    const double power = exp(eta[0]);
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T value = T(power) * from<T>(shape + i);
        to(part + i, value);
        to(slope[0] + i, value);
    });
}

// Writes the spectrum of a relaxation. `mirrored`: whether the spectrum is reflected about a quarter of the
// sample rate.
inline void relaxation(const Columns& b, bool mirrored, const double* eta, double* part,
                       double* const* slope) {
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

// For a part with an order: its order α, its parameter g = h^α f (h is the sampling period), and the
// derivatives of both by the part's first two free parameters.
struct Order {
    double alpha, g, by[2][2];
};

inline bool order_of(Part part, const Columns& b, const double* eta, Order& o) {
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

inline bool order(Part which, const Columns& b, const double* eta, double* part, double* const* slope) {
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

inline void arfima(const Columns& b, bool by_step, const double* eta, double* part, double* const* slope) {
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

inline void resonance(const Columns& b, const double* eta, double* part, double* const* slope) {
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

inline void rise(const Columns& b, const double* eta, double* part, double* const* slope) {
    const double power = exp(eta[0]);
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T ln = T(2.0) * (from<T>(b.ln_size + i) - T(kLn2));
        const T value = T(power) * exp(T(eta[1]) * ln);
        to(part + i, value);
        to(slope[0] + i, value);
        to(slope[1] + i, value * ln);
    });
}

// Writes the power gain of a low-pass. It is the sum of three analog gains: at the frequency itself, and at
// the two nearest frequencies that aliasing folds onto it.
inline void low_pass(const Columns& b, const double* eta, double* gain, double* const* slope) {
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
inline void high_pass(const Columns& b, const double* eta, double* gain, double* const* slope) {
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

// Writes the power gain of the filter with the taps -s, 1 + 2 s, -s.
inline void sharpening(const Columns& b, const double* eta, double* gain, double* const* slope) {
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T square = from<T>(b.square + i), h = T(1.0) + T(eta[0]) * square;
        to(gain + i, h * h);
        to(slope[0] + i, T(2.0) * square / h);
    });
}

// Writes the power gain of a notch. It is the gain of the bilinear transform of an analog notch, averaged
// over each bin.
inline void notch(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double at = exp(eta[0]), centre = ::tan(at / 2), square = centre * centre;
    const double width = centre * exp(eta[1]);
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T sine = from<T>(b.square + i) / T(4.0), cosine = T(1.0) - sine, step = from<T>(b.spread + i);
        const T away = sine - T(square) * cosine, flat = sine * cosine;
        // At one frequency, the gain is A / (A + K), where A grows with the distance from the notch, and K
        // with the notch's width. `value` is the mean of the gain over the frequencies of a bin, to second
        // order. K is taken as constant in the bin. With A at the bin's centre, the mean of A over the bin is
        // A + B, and its variance about 4 A B.
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

// Returns the power gain of a mean of m samples at the frequency `lam`. At some frequencies this gain is 0,
// which no logarithm can represent. It is therefore averaged over the frequencies of a bin. `step`: mean
// square distance of these frequencies from the bin's centre.
inline double mean_gain(double lam, double step, int m) {
    const double sine = ::sin(lam / 2), cosine = ::cos(lam / 2);
    const double above = ::sin(m * lam / 2), ratio = above / (m * sine);
    const double slope = (m * ::cos(m * lam / 2) * sine - above * cosine) / (2 * m * sine * sine);
    return max(ratio * ratio + slope * slope * step, 1e-6);
}

inline void mean(const Columns& b, int m, double* gain) {
    for (std::size_t i = 0; i < b.size; ++i) gain[i] = mean_gain(b.lam[i], b.spread[i], m);
}

// Writes the spectrum of a part, or the gain of a filter, with slopes (Kernel::term).
inline bool term_at(const Columns& b, Term term, const double* eta, double* part, double* const* slope) {
    switch (term.part) {
        case kWhite:
        case kFloor:
            white(b, eta, part, slope);
            return true;
        case kRelaxation:
        case kAlternating:
            relaxation(b, term.part == kAlternating, eta, part, slope);
            return true;
        case kWalk:
            scaled(b, b.walk, eta, part, slope);
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
            scaled(b, b.square, eta, part, slope);
            return true;
        case kRise:
            rise(b, eta, part, slope);
            return true;
        case kLowPass:
            low_pass(b, eta, part, slope);
            return true;
        case kHighPass:
            high_pass(b, eta, part, slope);
            return true;
        case kSharp:
            sharpening(b, eta, part, slope);
            return true;
        case kNotch:
            notch(b, eta, part, slope);
            return true;
        case kMean:
            mean(b, term.size, part);
            return true;
    }
    return false;
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace noise_models
}  // namespace fltea
