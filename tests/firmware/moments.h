// Mean and variance of counts, computed in double by the textbook's formulas.
#pragma once

#include <stdint.h>

#include <vector>

struct Moments {
    double mean, variance;
};

inline Moments in_two_passes(const std::vector<int16_t>& counts) {
    double sum = 0, squares = 0;
    for (int16_t count : counts) sum += count;
    const double n = static_cast<double>(counts.size()), mean = sum / n;
    for (int16_t count : counts) squares += (count - mean) * (count - mean);
    return Moments{mean, squares / (n - 1)};
}
