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
    // If there is no motion, but the samples stay at another mean, the tracker accepts that mean as the new
    // offset after `patience` samples, because the sensor may also be rotating. After only `still` samples,
    // it accepts the mean if the mean is nearer to 0 than the bias, if the caller reports rest, or if
    // `settles` is set.
    std::int64_t still = 1024, patience = 60000;
    // Whether `still` applies even to a mean that is farther from 0 than the bias. Such a mean may come from
    // a rotation.
    bool settles = true;
};

}  // namespace track
}  // namespace fltea
