// The results of the tracker of an axis, which estimates the axis's bias.
#pragma once

#include <cstdint>

namespace fltea {
namespace track {

// Estimate after a sample, in the unit of the sample. Figures that are not known yet are NaN.
struct Tracked {
    double state, state_std, bias, bias_std, innovation;
    bool moving;
};

struct TrackerCounts {
    std::uint64_t moved;  // number of samples in motion
    std::uint64_t begun;  // number of times that the tracker restarted because the offset had changed
    std::uint64_t steps;  // number of steps of the bias
};

// A step of the bias. The newest `ago` samples came after the step.
struct BiasStep {
    std::int64_t ago;
    double size, size_std;
};

}  // namespace track
}  // namespace fltea
