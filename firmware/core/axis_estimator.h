// One axis of the gyroscope: start-up window, filter, supervisor. The filter is the host's (engine/lane.hpp)
// in float, over a memory in integers. It is compiled once, in axis_estimator.cpp.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "engine/baseline.hpp"
#include "engine/supervisor.hpp"
#include "messages.h"
#include "settings.h"

namespace fltea {

class AxisEstimator {
  public:
    AxisEstimator() = default;
    AxisEstimator(const AxisEstimator&) = delete;
    AxisEstimator& operator=(const AxisEstimator&) = delete;

    // Forgets everything: a new start-up window.
    void begin();

    // One sample of the start-up window.
    void collect(int16_t count) { baseline_.add(count); }

    // The window is full.
    void start();

    // The filters go on with these; all that they remember stays. Only once there are filters.
    void retune(float Q_dps2, float R_dps2);

    // One sample after the window, or none (a lost one): a prediction.
    void step(const int16_t* count);

    // Fills in all but axis, sample and age.
    void report(Estimate& message) const;

    // Of the window; 0 while it fills, and R of an axis that never changed.
    float bias_dps() const;
    float r_dps2() const;
    // The same in squared counts.
    float variance() const { return filter_ == nullptr ? 0.0f : baseline_.variance(); }

    // Times since the window that the supervisor had to begin again.
    uint16_t restarts() const { return restarts_; }

    // Fills in what the filters are told.
    static void describe(Estimator& message);

  private:
    struct Filter;

    void begin_watch();

    static constexpr size_t kFilterBytes = 448;

    engine::Baseline<int16_t> baseline_;
    engine::Supervisor<float> supervisor_;
    Filter* filter_ = nullptr;  // in storage_, once the window is full and has given an R
    uint16_t restarts_ = 0;
    bool valid_ = false;
    bool missing_ = false;
    bool tuned_ = false;
    alignas(8) unsigned char storage_[kFilterBytes] = {};
};

}  // namespace fltea
