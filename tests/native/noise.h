// A source of noise with a variance of about 1, which is the same in every run. The noise is white enough for
// these tests, but not for anything else.
#pragma once

#include <cstddef>
#include <vector>

class Noise {
  public:
    explicit Noise(unsigned long long seed = 42) : state_(seed) {}
    double operator()() {
        double sum = -6;
        for (int i = 0; i < 12; ++i) sum += next();
        return sum;
    }
    double next() {
        state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
        return static_cast<double>(state_ >> 11) / 9007199254740992.0;
    }
    std::size_t below(std::size_t n) { return static_cast<std::size_t>(next() * static_cast<double>(n)); }

  private:
    unsigned long long state_;
};
