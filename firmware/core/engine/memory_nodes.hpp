// The nodes (decay rates) of the modes of the compressed memory (memory_compressed.hpp). The weights c_j of a
// fractional difference of order a are integrals over exponentials, written here with b = a + 1, for j > a >
// -1:
//
//     c_j(a)   = -(sin pi a / pi) ∫ p^b (1+p)^{-j-1} d log p
//     c_j(a)^2 = (sin pi a / pi)^2 4^b B(b, b) ∫ q^{2b} F (2/(2+q)) (1+q)^{-2j-1} d log q,
//                F = 2F1(b, 1/2; b + 1/2; w),  w = (q/(2+q))^2
//
// The first equation is the Beta integral of c_j. The second one uses this integral twice, where 1 + q is the
// geometric mean of the two factors 1 + p; F is written after a quadratic transformation. The order enters
// only through a power of the node and through F. On a grid that is uniform in log p and log q, with step D,
// the powers of the nodes are a geometric sequence with the ratio e^{-aD}. Nodes and modes therefore do not
// depend on the order, and the trapezoidal rule converges exponentially, by e^{-pi^2/D}.
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

// Configuration of a compressed memory, which compressed_config() makes from the user's settings.
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

// A set of modes with the nodes e^{(top - i) step}, i = 0 .. count-1, from the fastest to the slowest.
struct Bank {
    // number of steps from the node 1 to the fastest node, which is the fastest node's logarithm divided by
    // the step
    std::size_t top;
    std::size_t count;  // number of modes, a multiple of kGroup
};

// The sum over the modes is computed in this number of independent chains of operations. The number of modes
// is therefore a multiple of this number.
constexpr std::size_t kGroup = 4;

// The nodes for one configuration. They are computed with ::exp and similar functions of libm, whose last
// digit may differ between libraries, because this does not matter for nodes.
struct Nodes {
    // Number of newest samples whose weights are exact. Older samples are represented by the modes: their age
    // j far exceeds every order, and the fastest modes have already decayed.
    static constexpr std::size_t kHead = 15;
    // Number of newest samples for which an unlimited memory is accurate: 2^30 (124 days at 100 Hz).
    static constexpr double kHorizon = 1073741824.0;

    std::size_t window;
    double step;
    Bank state, variance;
    // How many terms of the series of F (see the top of this file) the groups of the variance's modes need.
    // Groups are counted from the fastest one. Groups before the index `four_terms` need four terms, later
    // groups before `two_terms` need two, and all others need one. At least one group needs only one term.
    std::size_t four_terms, two_terms;

    explicit Nodes(const CompressedConfig& config)
        : window(config.window), step(1), state(), variance(), four_terms(0), two_terms(0) {
        // so short a memory has no samples for the modes
        if (window > 0 && window <= kHead) return;
        const double error = ::pow(10.0, -double(config.digits));
        while (trapezoidal_error(step) > error) step -= 0.005;
        // The fastest nodes are chosen so that beyond them the integrands of the weight c_n, with n = kHead +
        // 1 and b = 2, are negligible in comparison with the integrals B(2, n-2) and B(4, 2n-3).
        const double n = kHead + 1.0;
        state.top = top(error, 2, n + 1, n * (n - 1));
        const double m = 2 * n;
        variance.top = top(error, 4, m + 1, m * (m - 1) * (m - 2) * (m - 3) / 6);
        // Modes that would be slower than the slowest node p are approximated by a parabola
        // (CompressedMemory::slow_end). The error of this approximation is of third order. It is about (j
        // p)^3/6 of what these modes contribute to the weight c_j, and they contribute at most (j p)^b of
        // that weight, with b = order + 1.
        const double slowest = ::log(0.8 * ::cbrt(error) / (window > 0 ? double(window) : kHorizon));
        state.count = count(state.top, slowest);
        variance.count = count(variance.top, slowest - 0.7);
        four_terms = groups_above(1.5 * ::sqrt(error));
        two_terms = groups_above(error);
    }

    double node(const Bank& bank, std::size_t i) const {
        return ::exp((double(bank.top) - double(i)) * step);
    }
    // Returns the argument w of the function F (see the top of this file) at the i-th node of the variance's
    // modes.
    double w(std::size_t i) const {
        const double q = node(variance, i);
        return (q / (2 + q)) * (q / (2 + q));
    }

  private:
    // Returns the relative error of the trapezoidal rule with step D for the integrand p^b e^{-jp} of the
    // weight c_j, at b = 2. The largest term of the error is the alias at frequency 2 pi/D, which is 2
    // |Gamma(b + 2 pi i/D)| / Gamma(b).
    static double trapezoidal_error(double D) {
        const double pi = 3.14159265358979324, y = 2 * pi / D;
        return 2 * ::sqrt((1 + y * y) * 2 * pi * y) * ::exp(-pi * y / 2);
    }

    // Returns how many grid steps (of the logarithm) the fastest node lies above 1. The integrand of a weight
    // is at most scale * x^power (1+x)^-decay at the node x. The fastest node is chosen so that this bound is
    // negligible at the next faster node.
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
