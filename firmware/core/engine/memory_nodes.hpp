// The nodes (decay rates) of the modes of the compressed memory (memory_compressed.hpp). The weights c_j of a
// fractional difference of order a are integrals over exponentials; with b = a + 1, for j > a > -1,
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

// Configuration of a compressed memory; compressed_config() makes it from the user's choice.
struct CompressedConfig {
    std::size_t window;  // length L of the memory in samples; 0: unlimited
    int digits;          // accuracy of the weights
};

constexpr int kDefaultDigits = 6;
constexpr int kLeastDigits = 3;
constexpr int kMostDigits = 11;

// `digits`, 3 to 11 (0: the default, 6), is the accuracy: each weight c_j that the modes approximate has a
// relative error below about 10^-digits for orders up to 1 (tables in host/docs/theory/filters.md). The first
// 15 weights and the weights of integer orders are exact. `window` is the length L of the memory in samples,
// or 0 for no limit. Numbers out of range are replaced by the nearest allowed ones.
inline CompressedConfig compressed_config(std::size_t window, int digits = kDefaultDigits) {
    if (digits == 0) digits = kDefaultDigits;
    if (digits < kLeastDigits) digits = kLeastDigits;
    if (digits > kMostDigits) digits = kMostDigits;
    return CompressedConfig{window, digits};
}

// A set of modes with the nodes e^{(top - i) step}, i = 0 .. count-1, from the fastest to the slowest.
struct Bank {
    std::size_t top;    // logarithm of the fastest node, divided by the step
    std::size_t count;  // a multiple of kGroup
};

// Modes are evaluated in groups of this size, as independent chains of operations.
constexpr std::size_t kGroup = 4;

// The nodes for one configuration. Here ::exp and similar functions are those of libm: their last digit,
// which may differ between libraries, does not matter for nodes.
struct Nodes {
    // Number of samples with exact weights. The modes take over from sample kHead + 1 on, where j far exceeds
    // every order and the fastest modes have already decayed.
    static constexpr std::size_t kHead = 15;
    // An unlimited memory is accurate for the last 2^30 samples (124 days at 100 Hz).
    static constexpr double kHorizon = 1073741824.0;

    std::size_t window;
    double step;
    Bank state, variance;
    // How many groups of the variance's modes need several terms of the series of F, counted from the
    // fastest: the first `four_terms` groups need four terms, the next ones up to `two_terms` need two, and
    // all others one. At least one group remains for the last case.
    std::size_t four_terms, two_terms;

    explicit Nodes(const CompressedConfig& config)
        : window(config.window), step(1), state(), variance(), four_terms(0), two_terms(0) {
        // the memory is so short that no samples are left for the modes
        if (window > 0 && window <= kHead) return;
        const double error = ::pow(10.0, -double(config.digits));
        while (trapezoidal_error(step) > error) step -= 0.005;
        // The fastest nodes are chosen for the integrands at b = 2, relative to their integrals B(2, n-2) and
        // B(4, 2n-3), for the weight c_n with n = kHead + 1.
        const double n = kHead + 1.0;
        state.top = top(error, 2, n + 1, n * (n - 1));
        const double m = 2 * n;
        variance.top = top(error, 4, m + 1, m * (m - 1) * (m - 2) * (m - 3) / 6);
        // Modes that would be slower than the slowest node p are approximated by a parabola
        // (CompressedMemory::slow_end). The error is a third-order term: about (j p)^3/6 of a weight that is
        // itself at most (j p)^b of the weights beside it.
        const double slowest = ::log(0.8 * ::cbrt(error) / (window > 0 ? double(window) : kHorizon));
        state.count = count(state.top, slowest);
        variance.count = count(variance.top, slowest - 0.7);
        four_terms = groups_above(1.5 * ::sqrt(error));
        two_terms = groups_above(error);
    }

    double node(const Bank& bank, std::size_t i) const {
        return ::exp((double(bank.top) - double(i)) * step);
    }
    // The argument w of F at the i-th node of the variance's modes.
    double w(std::size_t i) const {
        const double q = node(variance, i);
        return (q / (2 + q)) * (q / (2 + q));
    }

  private:
    // Relative error of the trapezoidal rule with step D for p^b e^{-jp} at b = 2. The largest term of the
    // error is the alias at frequency 2 pi/D: 2 |Gamma(b + 2 pi i/D)| / Gamma(b).
    static double trapezoidal_error(double D) {
        const double pi = 3.14159265358979324, y = 2 * pi / D;
        return 2 * ::sqrt((1 + y * y) * 2 * pi * y) * ::exp(-pi * y / 2);
    }

    // Logarithm of the fastest node, in steps. At the next faster node, x^power (1+x)^-decay, multiplied by
    // `scale`, is negligible.
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
