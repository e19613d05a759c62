// The spectra of all parts and the sums over them, for one instruction set (sentence_kernel.hpp). Compiled
// once per set, see CMakeLists.txt. It uses nothing from the standard library that has code: functions of the
// library would be shared between the sets by the linker.
#include "sentence_kernel.hpp"

#include <math.h>

#include "pack_log.hpp"
#include "set_name.hpp"

namespace fltea {
namespace sentence {
inline namespace FLTEA_INSTRUCTION_SET {
namespace {

using engine::exp;
using engine::log;
using engine::sin_pi;

double least_of(double a, double b) { return a < b ? a : b; }
double most_of(double a, double b) { return a > b ? a : b; }

// Sums in eight lanes: the compiler makes vectors of them, and the result does not depend on which.
template <class Term>
double sum_of(std::size_t size, const Term& term) {
    double lane[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    std::size_t i = 0;
    for (; i + 8 <= size; i += 8)
        for (std::size_t k = 0; k < 8; ++k) lane[k] += term(i + k);
    for (; i < size; ++i) lane[i % 8] += term(i);
    return ((lane[0] + lane[4]) + (lane[1] + lane[5])) + ((lane[2] + lane[6]) + (lane[3] + lane[7]));
}

double share_of(double logit) { return 1 / (1 + exp(-logit)); }

// `mirrored`: about a quarter of the sample rate.
void relaxation(const Columns& b, bool mirrored, const double* eta, double* part, double* const* slope) {
    const double rate = exp(eta[1]), phi = exp(-rate), left = -::expm1(-rate);
    const double gap = -::expm1(-2 * rate), level = exp(eta[0]) * gap, own = 2 * phi / gap;
    for (std::size_t i = 0; i < b.size; ++i) {
        const double square = mirrored ? 4 - b.square[i] : b.square[i];
        const double distance = left * left + phi * square;
        part[i] = level / distance;
        slope[0][i] = part[i];
        slope[1][i] = part[i] * rate * phi * (own + (square - 2 * left) / distance);
    }
}

// α, g and log s2, with the slopes of α and g by the two first coordinates.
struct Order {
    double alpha, g, by[2][2];
};

bool order_of(Part part, const Columns& b, const double* eta, Order& o) {
    if (part == kOrder) {
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
    const double s2 = exp(eta[2]), alpha = o.alpha, g = o.g;
    for (std::size_t i = 0; i < b.size; ++i) {
        const double size = exp(alpha * b.ln_size[i]);
        const double turn = (alpha * b.quarter[i] + b.lam[i]) / kPi;
        const double real = size * sin_pi(turn + 0.5), imaginary = size * sin_pi(turn);
        const double distance = most_of(size * size - 2 * g * real + g * g, 1e-200);
        const double value = s2 / distance;
        const double by_alpha =
            -2 * (size * size * b.ln_size[i] - g * (b.ln_size[i] * real - b.quarter[i] * imaginary)) /
            distance;
        const double by_g = 2 * (real - g) / distance;
        part[i] = value;
        slope[0][i] = value * (by_alpha * o.by[0][0] + by_g * o.by[1][0]);
        slope[1][i] = value * (by_alpha * o.by[0][1] + by_g * o.by[1][1]);
        slope[2][i] = value;
    }
    return true;
}

void arfima(const Columns& b, const double* eta, double* part, double* const* slope) {
    const double rate = exp(eta[1]), phi = exp(-rate), left = -::expm1(-rate);
    const double level = exp(eta[2]) * left * left;
    for (std::size_t i = 0; i < b.size; ++i) {
        const double distance = left * left + phi * b.square[i];
        part[i] = level * exp(-2 * eta[0] * b.ln_size[i]) / distance;
        slope[0][i] = -2 * b.ln_size[i] * part[i];
        slope[1][i] = part[i] * rate * phi * (2 / left - (2 * left - b.square[i]) / distance);
        slope[2][i] = part[i];
    }
}

void resonance(const Columns& b, const double* eta, double* part, double* const* slope) {
    const double at = exp(eta[1]), width = at * exp(eta[2]), r = exp(-width), p = exp(eta[0]);
    const double c = ::cos(at), s = ::sin(at), c2 = c * c - s * s, s2 = 2 * s * c;
    const double one = 1 - r, other = 1 - 2 * r * c2 + r * r;
    const double top = p * one * one * other;
    const double top_by_r = -2 / one + (2 * r - 2 * c2) / other, top_by_at = 4 * r * s2 / other;
    for (std::size_t i = 0; i < b.size; ++i) {
        const double near = b.cos1[i] * c + b.sin1[i] * s, far = b.cos1[i] * c - b.sin1[i] * s;
        const double sin_near = b.sin1[i] * c - b.cos1[i] * s, sin_far = b.sin1[i] * c + b.cos1[i] * s;
        const double d1 = 1 - 2 * r * near + r * r, d2 = 1 - 2 * r * far + r * r;
        const double value = top / (d1 * d2);
        part[i] = value;
        slope[0][i] = value;
        slope[2][i] = -value * width * r * (top_by_r - 2 * (r - near) / d1 - 2 * (r - far) / d2);
        slope[1][i] = value * at * (top_by_at + 2 * r * (sin_near / d1 - sin_far / d2)) + slope[2][i];
    }
}

// The sum of the branches that lie over each other once it is sampled.
void low_pass(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double share = share_of(eta[1]), n = 1 + (kMostPoles - 1) * share;
    const double by_n = (kMostPoles - 1) * share * (1 - share);
    for (std::size_t i = 0; i < b.size; ++i) {
        double sum = 0, by_c = 0, by_poles = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const double ratio = b.branch[k * b.size + i] - eta[0];
            const double one = 1 / (1 + exp(least_of(n * ratio, 200.0)));
            sum += one;
            by_c += one * (1 - one);
            by_poles += one * (1 - one) * ratio;
        }
        gain[i] = sum;
        slope[0][i] = n * by_c / sum;
        slope[1][i] = -by_poles / sum * by_n;
    }
}

// The bilinear transform of an analog notch, as digital ones are; the mean over each bin, at its bottom.
void notch(const Columns& b, const double* eta, double* gain, double* const* slope) {
    const double at = exp(eta[0]), centre = ::tan(at / 2), square = centre * centre;
    const double width = centre * exp(eta[1]);
    for (std::size_t i = 0; i < b.size; ++i) {
        const double sine = b.square[i] / 4, cosine = 1 - sine, step = b.spread[i];
        const double away = sine - square * cosine, flat = sine * cosine;
        const double stopped = away * away + flat * (1 + square) * (1 + square) * step;
        const double skirt = width * width * flat, whole = stopped + skirt;
        gain[i] = stopped / whole;
        const double by_square =
            (-2 * away * cosine + 2 * flat * (1 + square) * step) / stopped * skirt / whole;
        const double by_width = -2 * skirt / whole;
        slope[0][i] = (by_square * 2 * square + by_width) * at * (1 + square) / (2 * centre);
        slope[1][i] = by_width;
    }
}

// The mean over a bin, `step` its spread: at the filter's zeros that is not 0.
double mean_gain(double lam, double step, int m) {
    const double sine = ::sin(lam / 2), cosine = ::cos(lam / 2);
    const double above = ::sin(m * lam / 2), ratio = above / (m * sine);
    const double slope = (m * ::cos(m * lam / 2) * sine - above * cosine) / (2 * m * sine * sine);
    return most_of(ratio * ratio + slope * slope * step, 1e-6);
}

bool word_at(const Columns& b, Word word, const double* eta, double* part, double* const* slope) {
    const std::size_t n = b.size;
    const auto level = [&](const double* shape) {
        const double power = exp(eta[0]);
        for (std::size_t i = 0; i < n; ++i) slope[0][i] = part[i] = power * shape[i];
    };
    switch (word.part) {
        case kWhite:
        case kFloor: {
            const double power = exp(eta[0]);
            for (std::size_t i = 0; i < n; ++i) slope[0][i] = part[i] = power;
            return true;
        }
        case kRelaxation:
        case kAlternating:
            relaxation(b, word.part == kAlternating, eta, part, slope);
            return true;
        case kWalk:
            level(b.walk);
            return true;
        case kOrder:
        case kOrderByF:
        case kOrderByf:
            return order(word.part, b, eta, part, slope);
        case kArfima:
            arfima(b, eta, part, slope);
            return true;
        case kResonance:
            resonance(b, eta, part, slope);
            return true;
        case kQuantised:
            level(b.square);
            return true;
        case kRise: {
            const double power = exp(eta[0]);
            for (std::size_t i = 0; i < n; ++i) {
                const double ln = 2 * (b.ln_size[i] - kLn2);
                slope[0][i] = part[i] = power * exp(eta[1] * ln);
                slope[1][i] = part[i] * ln;
            }
            return true;
        }
        case kLowPass:
            low_pass(b, eta, part, slope);
            return true;
        case kSharp:
            for (std::size_t i = 0; i < n; ++i) {
                const double h = 1 + eta[0] * b.square[i];
                part[i] = h * h;
                slope[0][i] = 2 * b.square[i] / h;
            }
            return true;
        case kNotch:
            notch(b, eta, part, slope);
            return true;
        default:
            for (std::size_t i = 0; i < n; ++i) part[i] = mean_gain(b.lam[i], b.spread[i], word.size);
            return true;
    }
}

double nll(const Columns& b, const double* total) {
    return sum_of(b.size,
                  [&](std::size_t i) { return b.counts[i] * (log(total[i]) + b.power[i] / total[i]); });
}

void derivatives(const Columns& b, const double* total, int free, const double* const* slopes, double* over,
                 double* gradient, double* information) {
    for (std::size_t i = 0; i < b.size; ++i) over[i] = b.counts[i] * (1 - b.power[i] / total[i]);
    for (int k = 0; k < free; ++k)
        gradient[k] = sum_of(b.size, [&](std::size_t i) { return over[i] * slopes[k][i]; });
    for (int k = 0; k < free; ++k) {
        for (std::size_t i = 0; i < b.size; ++i) over[i] = b.counts[i] * slopes[k][i];
        for (int j = 0; j <= k; ++j) {
            const double* const other = slopes[j];
            information[k * kMostFree + j] = information[j * kMostFree + k] =
                sum_of(b.size, [&](std::size_t i) { return over[i] * other[i]; });
        }
    }
}

double dot(std::size_t size, const double* a, const double* b) {
    return sum_of(size, [&](std::size_t i) { return a[i] * b[i]; });
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

extern const Kernel FLTEA_JOIN(kernel_, FLTEA_INSTRUCTION_SET) = {FLTEA_STRING(FLTEA_INSTRUCTION_SET),
                                                                  word_at, nll, derivatives, dot};

}  // namespace sentence
}  // namespace fltea
