// Helpers for the tests of the device's noise fits: simulated counts of noise, and short names of the classes
// under test.
#pragma once
#include <doctest/doctest.h>

#include <memory>
#include <random>
#include <vector>

#include "engine/count_spectrum.hpp"
#include "engine/fit_bins.hpp"
#include "estimation.h"
#include "mpu9250.h"
#include "noise_fit.h"
#include "rig.h"

using fltea::Estimator;
using fltea::Fit;
using fltea::NoiseFit;
using fltea::Spectrum;
namespace settings = fltea::settings;
namespace whittle = fltea::whittle;

namespace {

typedef fltea::engine::CountOctaves<> Octaves;
typedef fltea::engine::FitBins<Octaves> Bins;

constexpr float kCountsPerDps = static_cast<float>(fltea::kGyroLsbTenths) / 10.0f;

// A source of noise: each call of the object returns the next sample of white noise plus a slow state (a
// relaxation, which is a first-order Gauss-Markov process), in counts.
class Counts {
  public:
    explicit Counts(unsigned seed, double slow = 0.5) : random_(seed), white_(0, 3), slow_(0, slow) {}
    int16_t operator()() {
        state_ += 0.02 * (0 - state_) + slow_(random_);
        return static_cast<int16_t>(std::floor(white_(random_) + state_ + 0.5));
    }

  private:
    std::mt19937 random_;
    std::normal_distribution<double> white_, slow_;
    double state_ = 0;
};

}  // namespace
