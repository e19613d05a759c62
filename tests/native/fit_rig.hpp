// What the tests of the device's spectrum and the tests of its fit share: simulated counts of noise, and the
// bins of their spectrum.
#pragma once

#include <cmath>
#include <cstdint>

#include "fit_bins.hpp"
#include "noise.h"

namespace {

typedef fltea::engine::CountOctaves<> Octaves;
typedef fltea::engine::FitBins<Octaves> Gathered;

// Makes counts of white noise plus a sum of relaxations (first-order Gauss-Markov processes) whose corner
// frequencies differ by factors of 4.
class Counts {
  public:
    Counts(int parts, double share, double deviation, unsigned long long seed)
        : parts_(parts), share_(share), deviation_(deviation), random_(seed) {}
    std::int16_t operator()() {
        double y = random_();
        for (int k = 0; k < parts_; ++k) {
            const double rate = 0.3 / std::pow(4.0, k);
            state_[k] += rate * (std::sqrt((2 - rate) / rate) * share_ * random_() - state_[k]);
            y += state_[k];
        }
        return static_cast<std::int16_t>(std::floor(deviation_ * y + 0.5));
    }

  private:
    int parts_;
    double share_, deviation_;
    Noise random_;
    double state_[8] = {};
};

void make_bins(const Octaves& octaves, Gathered& bins) {
    bins.begin();
    while (!bins.step(octaves)) {
    }
}

}  // namespace
