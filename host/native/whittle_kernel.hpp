// The functions with which noise models are fitted. There is one table of these functions for each
// instruction set. They use plain data only. whittle_kernel.cpp is compiled once for each instruction set,
// for the reasons in engine.hpp. This file has declarations only. The caller owns all memory.
//
// A noise model is a list of noise parts ("terms"). Its spectrum at the frequency λ is S(λ) = L(λ) (Σ of
// parts) + floor, where L is the gain of a chain of filters, and floor is white noise added after these
// filters. The parameters are logarithms of powers and rates. A step of a fit can then change a very weak
// part as much, in proportion, as a strong one. An example is a random walk with 1e-8 of the power of the
// white noise.
#pragma once

#include <cstddef>

#include "whittle_parts.hpp"

namespace fltea {
namespace noise_models {

constexpr double kPi = 3.14159265358979323846;

constexpr int kMostFree = 24;
constexpr double kMostPoles = 24;
// Limits for the power of a part. The logarithm of the power may be smaller by kSmallest or larger by
// kLargest than the logarithm of the mean power of the data.
constexpr double kSmallest = 30, kLargest = 30;
constexpr double kNoPole = 2.5;  // largest log r, where ARFIMA's φ is e^-r; φ is then nearly 0 (5e-6)

// One part of a noise model. `size` is only used for the part kMean, which is the mean of m samples. For
// kMean, `size` is m.
struct Term {
    Part part;
    int size;
};

// The columns of the bins, with a number for each bin. They do not depend on the parameters of a model.
struct Columns {
    std::size_t size;
    const double* counts;  // number of periodogram ordinates in the bin
    const double* power;
    const double* lam;
    const double* square;   // |1 - e^{-iλ}|², where λ is the frequency
    const double* cos1;     // cosine of the frequency λ
    const double* sin1;     // sine of the frequency λ
    const double* ln_size;  // log |1 - e^{-iλ}|, where λ is the frequency
    const double* quarter;  // (π - λ) / 2, where λ is the frequency
    const double* walk;     // spectrum of a random walk with steps of variance 1, including leakage
    const double* spread;   // mean square distance of the frequencies in a bin from its centre
    const double* branch;   // three rows: log λ², log (2π - λ)² and log (2π + λ)², where λ is the frequency
    double log_h, lowest_order, highest_order;
};

struct Kernel {
    const char* name;
    // Writes the spectrum of a part and its derivatives by the part's parameters `eta`. For a filter, writes
    // the gain and the derivatives of the gain's logarithm. Returns false if there is no spectrum for these
    // parameters.
    bool (*term)(const Columns& bins, Term term, const double* eta, double* part, double* const* slope);
    // Returns -log L = Σ c (log S + I/S). S is the spectrum of the model in `total`, I is the measured power
    // of a bin, and c is its number of ordinates.
    double (*nll)(const Columns& bins, const double* total);
    // Replaces `total`, which is the sum of the parts, by the whole spectrum S = total · gain + floor. Writes
    // 1 / S to `inverse` and gain / S to `over`. Replaces `floor` by the share total · gain / S, which is the
    // part of the power that has passed the filters. All arrays have the shape (size,).
    void (*whole)(std::size_t size, const double* gain, double* total, double* floor, double* inverse,
                  double* over);
    // Writes the gradient of -log L, of shape (free,), and its expected curvature, of shape (free,
    // kMostFree). `slopes`: derivatives of log S by the parameters. `over`: work space of shape (size,).
    void (*derivatives)(const Columns& bins, const double* total, int free, const double* const* slopes,
                        double* over, double* gradient, double* information);
    // Writes to `found` the scalar product of a with each of the `count` rows b in `rows`. The scalar product
    // is the sum Σ a b over all bins.
    void (*dots)(std::size_t size, const double* a, int count, const double* const* rows, double* found);
    // Writes the products a b to `into`, which may be the same array as a or b.
    void (*times)(std::size_t size, const double* a, const double* b, double* into);
    // Adds the numbers a to those in `into`.
    void (*plus)(std::size_t size, const double* a, double* into);
    // Writes 1/a to `inverse`, and replaces each a by its logarithm.
    void (*inverted)(std::size_t size, double* a, double* inverse);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

}  // namespace noise_models
}  // namespace fltea
