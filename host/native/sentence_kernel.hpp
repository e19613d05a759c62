// What the fits of sentences need of each instruction set: plain data and one table of functions
// (sentence_kernel.cpp is compiled once for each set, as engine.hpp says of the engine). Nothing in this file
// is code but the lists of what there is. The caller owns all memory.
//
// A noise is a sentence of parts: S(λ) = L(λ) (Σ of parts) + floor, where L is a chain of filters. Powers and
// rates are logarithms, so that a random walk of 1e-8 of the white noise has the same weight in a search as
// the white noise itself.
#pragma once

#include <cstddef>

#include "sentence_parts.hpp"

namespace fltea {
namespace sentence {

constexpr double kPi = 3.14159265358979323846;

constexpr int kMostFree = 24;
constexpr double kMostPoles = 24;
constexpr double kSmallest = 30, kLargest = 30;  // log of a power over the mean
constexpr double kNoPole = 2.5;                  // φ = 5e-6

// One part of a sentence; `size` is m of kMean.
struct Word {
    Part part;
    int size;
};

// What does not depend on the parameters, of each bin.
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
    const double* walk;     // spectrum of a walk of unit steps, with what leaks of it
    const double* spread;   // mean square of the distance from its centre, of the lines in a bin
    const double* branch;   // 3 x size: log λ², log (2π - λ)², log (2π + λ)²
    double log_h, lowest_order, highest_order;
};

struct Kernel {
    const char* name;
    // The spectrum of a word and its slopes by its parameters; of a filter its gain, and the slopes of the
    // gain's logarithm. False if there is no such spectrum.
    bool (*word)(const Columns& bins, Word word, const double* eta, double* part, double* const* slope);
    // Σ c (log S + I/S).
    double (*nll)(const Columns& bins, const double* total);
    // total, the sum of the parts, becomes the whole spectrum total · gain + floor; inverse: one over that;
    // over: gain over that; floor becomes the share that has passed the filters. All (size,).
    void (*whole)(std::size_t size, const double* gain, double* total, double* floor, double* inverse,
                  double* over);
    // Gradient (free,) of that by parameters, of which `slopes` are the slopes of log S, and expected
    // curvature (free, kMostFree); over (size,) is room.
    void (*derivatives)(const Columns& bins, const double* total, int free, const double* const* slopes,
                        double* over, double* gradient, double* information);
    // Σ a b of each of `count` rows b.
    void (*dots)(std::size_t size, const double* a, int count, const double* const* rows, double* found);
    // a b, which may be put in place of either.
    void (*times)(std::size_t size, const double* a, const double* b, double* into);
    // into += a.
    void (*plus)(std::size_t size, const double* a, double* into);
    // 1/a; a becomes its logarithm.
    void (*inverted)(std::size_t size, double* a, double* inverse);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

}  // namespace sentence
}  // namespace fltea
