// The nodes of the compressed memory (memory_compressed.hpp). That memory replaces past values by modes,
// which are exponentially decaying sums of them. A node is the decay rate of a mode. The weights c_j of a
// fractional difference of order a are integrals over exponentials, written here with decay rates p and q,
// with b = a + 1, and for j > a > -1:
//
//     c_j(a)   = -(sin pi a / pi) ∫ p^b (1+p)^{-j-1} d log p
//     c_j(a)^2 = (sin pi a / pi)^2 4^b B(b, b) ∫ q^{2b} F (2/(2+q)) (1+q)^{-2j-1} d log q,
//                F = 2F1(b, 1/2; b + 1/2; w),  w = (q/(2+q))^2
//
// The first equation is the Beta integral of c_j. The second one is the square of the first, a double
// integral over two rates p. There 1 + q is the geometric mean of the two factors 1 + p, and the integral
// over their ratio is F, after a quadratic transformation. The order enters only as an exponent of p and q,
// and through F. On a grid that is uniform in log p and log q, with step D, the powers of the nodes are a
// geometric sequence with the ratio e^{-aD}. Nodes and modes therefore do not depend on the order, and the
// trapezoidal rule converges exponentially, by e^{-pi^2/D}.
#ifndef FLTEA_MEMORY_NODES_HPP
#define FLTEA_MEMORY_NODES_HPP

#include <math.h>

#include <cstddef>
#include <cstdint>

#include "memory_constants.hpp"
#include "pack.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Configuration of a compressed memory of past states, which compressed_config() makes from the user's
// settings.
struct CompressedConfig {
    std::size_t window;  // length L of the memory in samples; 0: unlimited
    int digits;          // number of accurate digits of the weights, as in compressed_config()
};

constexpr int kDefaultDigits = 6;
constexpr int kLeastDigits = 3;
constexpr int kMostDigits = 11;

// Returns the configuration of a compressed memory. `window`: length L of the memory in samples, or 0 for no
// limit. `digits`: accuracy, from 3 to 11, or 0 for the default, which is 6. Each weight c_j that the modes
// approximate has a relative error below about 10^-digits for orders up to 1 (tables in
// host/docs/theory/filters.md). The first 15 weights and the weights of integer orders are exact. If `digits`
// is out of range, the nearest allowed number is used.
inline CompressedConfig compressed_config(std::size_t window, int digits = kDefaultDigits) {
    if (digits == 0) digits = kDefaultDigits;
    if (digits < kLeastDigits) digits = kLeastDigits;
    if (digits > kMostDigits) digits = kMostDigits;
    return CompressedConfig{window, digits};
}

// A set of modes (decaying sums of the past). Their nodes (decay rates) are e^{(top - i) step}, i = 0 ..
// count-1, from the fastest to the slowest.
struct Bank {
    // number of grid steps from a decay rate of 1 up to the fastest node, which is e^{top step}
    std::size_t top;
    std::size_t count;  // number of modes, a multiple of kGroup
};

// The sum over the modes is computed in this number of independent chains of operations. The number of modes
// is therefore a multiple of this number.
constexpr std::size_t kGroup = 4;

// The nodes (decay rates of the modes) for one configuration. They are computed with ::exp and similar
// functions of libm. The last digit of these may differ between libraries, which does not matter for nodes.
struct Nodes {
    // Number of newest samples whose weights are exact. Older samples are represented by the modes (decaying
    // sums). At the age j of these samples, the integrals at the top of this file hold for every order (j >
    // a). Very fast modes are not needed, because they would only contribute to the newest samples' weights.
    static constexpr std::size_t kHead = 15;
    // Number of newest samples for which an unlimited memory is accurate: 2^30 (124 days at 100 Hz).
    static constexpr double kHorizon = 1073741824.0;

    std::size_t window;
    double step;
    Bank state, variance;
    // The function F (see the top of this file) is computed as a series, which needs more terms for fast
    // modes than for slow ones. The modes of the variances are in groups of kGroup, from the fastest to the
    // slowest. Groups before the index `four_terms` need four terms, later groups before `two_terms` need
    // two, and all others need one. At least one group needs only one term.
    std::size_t four_terms, two_terms;

    explicit Nodes(const CompressedConfig& config)
        : window(config.window), step(1), state(), variance(), four_terms(0), two_terms(0) {
        // all weights of so short a memory are exact, so it needs no modes
        if (window > 0 && window <= kHead) return;
        const double error = ::pow(10.0, -double(config.digits));
        while (trapezoidal_error(step) > error) step -= 0.005;
        // The fastest nodes are chosen so that faster ones would add a negligible part to the integrals of
        // c_n and c_n^2 (see the top of this file). n = kHead + 1 is the least age of a sample in the modes.
        // At b = 2, these integrals are about the Beta functions B(2, n-1) and B(4, 2n-3).
        const double n = kHead + 1.0;
        state.top = top(error, 2, n + 1, n * (n - 1));
        const double m = 2 * n;
        variance.top = top(error, 4, m + 1, m * (m - 1) * (m - 2) * (m - 3) / 6);
        // Modes slower than the slowest node p are not stored. At the age of j samples, they contribute at
        // most the part (j p)^b of the weight c_j, with b = order + 1. A parabola approximates their
        // contribution (CompressedMemory::slow_end), with an error of about (j p)^3/6 of it. The slowest node
        // is so small that this suffices up to the greatest age j (`window` or kHorizon).
        const double slowest = ::log(0.8 * ::cbrt(error) / (window > 0 ? double(window) : kHorizon));
        state.count = count(state.top, slowest);
        variance.count = count(variance.top, slowest - 0.7);
        four_terms = groups_above(1.5 * ::sqrt(error));
        two_terms = groups_above(error);
    }

    double node(const Bank& bank, std::size_t i) const {
        return ::exp((double(bank.top) - double(i)) * step);
    }
    // Returns the argument w of the function F (see the top of this file) at the i-th node of the modes of
    // past variances.
    double w(std::size_t i) const {
        const double q = node(variance, i);
        return (q / (2 + q)) * (q / (2 + q));
    }

  private:
    // Returns the relative error of the trapezoidal rule with step D for the weight c_j, an integral over log
    // p (see the top of this file) at b = 2. The integrand is nearly p^b e^{-jp}. The error is mainly the
    // magnitude of its Fourier transform at the frequency 2 pi/D. This is 2 |Gamma(b + 2 pi i/D)| / Gamma(b),
    // relative to the integral.
    static double trapezoidal_error(double D) {
        const double pi = 3.14159265358979324, y = 2 * pi / D;
        return 2 * ::sqrt((1 + y * y) * 2 * pi * y) * ::exp(-pi * y / 2);
    }

    // Returns the number of grid steps from the node 1 up to the fastest node. At the node x, the integrand
    // for a weight is at most scale * x^power (1+x)^-decay, relative to its integral. The first node at which
    // this bound is below error / 4 is left out, with all faster ones.
    std::size_t top(double error, double power, double decay, double scale) const {
        std::size_t steps = 0;
        while (scale * ::pow(::exp(double(steps + 1) * step), power) *
                   ::pow(1 + ::exp(double(steps + 1) * step), -decay) >
               error / 4) {
            ++steps;
        }
        return steps;
    }

    std::size_t count(std::size_t first, double slowest) const {
        const std::size_t needed = static_cast<std::size_t>(::ceil(double(first) - slowest / step)) + 1;
        return (needed + kGroup - 1) / kGroup * kGroup;
    }

    std::size_t groups_above(double threshold) const {
        std::size_t group = 0;
        while (group + 1 < variance.count / kGroup && w(group * kGroup) > threshold) ++group;
        return group;
    }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
