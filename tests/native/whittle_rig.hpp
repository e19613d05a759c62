// What the tests of noise models share: bins with given powers, and an example of each noise part.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "whittle_fit.hpp"

namespace {

using namespace fltea::noise_models;

// Returns bins of a spectrum whose width is proportional to the frequency, like those of the live spectrum.
// Their powers are 1.
inline Bins bins_of(std::size_t size, double samples = 60000) {
    Numbers lam, counts, walk;
    const double lowest = 25 / samples, ratio = std::pow(kPi / lowest, 1 / static_cast<double>(size));
    for (std::size_t i = 0; i < size; ++i) {
        const double begin = lowest * std::pow(ratio, static_cast<double>(i)), end = begin * ratio;
        lam.push_back((begin + end) / 2);
        counts.push_back(std::fmax(1.0, (end - begin) * samples / (2 * kPi)));
        walk.push_back(1 / std::pow(2 * std::sin(lam.back() / 2), 2));
    }
    return Bins(kernel_baseline, lam, counts, Numbers(size, 1.0), walk, Numbers(size), 0.01);
}

// Returns bins with the same frequencies and numbers of periodogram values, but with the powers `power`.
inline Bins with_power(const Bins& bins, const Numbers& power) {
    return Bins(kernel_baseline, bins.lam, bins.counts, power, bins.walk, Numbers(bins.size()), 0.01);
}

inline Numbers spectrum(const Bins& bins, const Terms& terms, const std::vector<double>& eta) {
    Spectrum at(bins);
    at.at(terms, eta.data());
    return at.total();
}

// Draws a random power for each bin, distributed like the mean of the bin's exponentially distributed
// ordinates. The expected powers are `power`.
inline Numbers drawn(const Bins& bins, Numbers power, unsigned seed) {
    std::mt19937 random(seed);
    for (std::size_t i = 0; i < power.size(); ++i)
        power[i] *= std::gamma_distribution<double>(bins.counts[i], 1 / bins.counts[i])(random);
    return power;
}

// Returns free parameters of a noise part. They are well inside their bounds, and computed from three numbers
// between 0.3 and 0.9.
inline std::vector<double> inside(Part part, double a, double b, double c) {
    switch (part) {
        case kWhite:
        case kQuantised:
        case kSharp:
        case kFloor:
            return {a};
        case kRelaxation:
            return {a, -4 * b};
        case kWalk:
            return {a - 4};
        case kOrder:
            return {a, -4 * b, c};
        case kResonance:
            return {a, -4 * b, -1 - c};
        case kRise:
            return {a, b};
        case kLowPass:
            return {-3 * a, -b};
        case kNotch:
            return {-b, -c};
        case kMean:
            return {};
        case kAlternating:
            return {a, -b};
        case kArfima:
        case kArfimaByStep:
            return {a, -b, c};
        case kHighPass:
            return {-2 - 8 * a, -3 - 2 * b};
        case kOrderByF:
            return {a - 0.5, b - 0.5, c};
        case kOrderByf:
            return {a, 2 * b, c};
        case kOrderByQ:
            return {a, -4 * b, c};
    }
    return {};
}

// A model of white noise, a relaxation and one more part, with parameters well inside their bounds.
struct Example {
    Terms terms;
    std::vector<double> eta;

    Example(Part part, std::mt19937& random)
        : terms{{kWhite, 0}, {kRelaxation, 0}, {part, 3}}, eta{0, 0, -3} {
        std::uniform_real_distribution<double> some(0.3, 0.9);
        const double a = some(random), b = some(random), c = some(random);
        for (const double one : inside(part, a, b, c)) eta.push_back(one);
    }
};

}  // namespace
