// Settings of the bias tracker of a sensor.
#pragma once

#include <cstdint>
#include <limits>

#include "tracker_model.hpp"

namespace fltea {
namespace track {

struct TrackerRules : BiasLengths {
    // A change of the samples' mean counts as a step of the bias if it is at most this large. A larger change
    // counts as motion.
    double largest_step = std::numeric_limits<double>::infinity();
    // When the samples stay at another mean, the tracker accepts that mean as the new offset after this
    // number of samples without motion. `still` applies if the new mean is nearer to 0, if the caller reports
    // rest, or if `settles` is set. Otherwise the sensor may be rotating, and `patience` applies.
    std::int64_t still = 1024, patience = 60000;
    // Whether the tracker accepts a mean farther from 0 as the new offset as quickly as a mean nearer to 0,
    // although the former may come from a rotation.
    bool settles = true;
};

}  // namespace track
}  // namespace fltea
