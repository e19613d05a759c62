// What the fits of noise models need from each instruction set: plain data and one table of functions.
// whittle_kernel.cpp is compiled once for each set, as engine.hpp explains for the engine. This file has
// declarations only. The caller owns all memory.
//
// A noise model is a list of parts ("terms") with the spectrum S(λ) = L(λ) (Σ of parts) + floor, where L is a
// chain of filters. Powers and rates are logarithms, so that a random walk of 1e-8 of the white noise has the
// same weight in a search as the white noise itself.
#pragma once

#include <cstddef>

#include "whittle_parts.hpp"

namespace fltea {
namespace whittle {

constexpr double kPi = 3.14159265358979323846;

constexpr int kMostFree = 24;
constexpr double kMostPoles = 24;
constexpr double kSmallest = 30, kLargest = 30;  // log of a power over the mean power
constexpr double kNoPole = 2.5;                  // log rate at which φ is 5e-6

// One part of a model; `size` is m of kMean.
struct Term {
    Part part;
    int size;
};

// The properties of each bin that do not depend on the parameters.
struct Columns {
    std::size_t size;
    const double* counts;  // ordinates
    const double* power;
    const double* lam;
    const double* square;  // |1 - e^{-iλ}|²
    const double* cos1;    // cos λ, sin λ
    const double* sin1;
    const double* ln_size;  // log |1 - e^{-iλ}|
    const double* quarter;  // (π - λ) / 2
    const double* walk;     // spectrum of a random walk with unit steps, with its leakage
    const double* spread;   // mean square of the distance of a bin's lines from its centre
    const double* branch;   // 3 x size: log λ², log (2π - λ)², log (2π + λ)²
    double log_h, lowest_order, highest_order;
};

struct Kernel {
    const char* name;
    // Writes the spectrum of a part and its derivatives by the part's parameters; for a filter, its gain and
    // the derivatives of the gain's logarithm. Returns false if there is no such spectrum.
    bool (*term)(const Columns& bins, Term term, const double* eta, double* part, double* const* slope);
    // Returns Σ c (log S + I/S).
    double (*nll)(const Columns& bins, const double* total);
    // Turns `total`, the sum of the parts, into the whole spectrum total · gain + floor. Also writes
    // `inverse` = 1 / total and `over` = gain / total, and turns `floor` into the share that has passed the
    // filters. All (size,).
    void (*whole)(std::size_t size, const double* gain, double* total, double* floor, double* inverse,
                  double* over);
    // Writes the gradient of -log L (free,) and its expected curvature (free, kMostFree); `slopes`:
    // derivatives of log S by the parameters; `over` (size,): work space.
    void (*derivatives)(const Columns& bins, const double* total, int free, const double* const* slopes,
                        double* over, double* gradient, double* information);
    // Writes Σ a b for each of `count` rows b.
    void (*dots)(std::size_t size, const double* a, int count, const double* const* rows, double* found);
    // Writes the products a b; `into` may be a or b.
    void (*times)(std::size_t size, const double* a, const double* b, double* into);
    // Adds a to `into`.
    void (*plus)(std::size_t size, const double* a, double* into);
    // Writes 1/a to `inverse`, and replaces a by its logarithm.
    void (*inverted)(std::size_t size, double* a, double* inverse);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

}  // namespace whittle
}  // namespace fltea
