// The estimator of one gyroscope axis: start-up window, filter and supervisor. The filter is the host's
// (engine/lane.hpp) in float, with a memory in integers. It is compiled once, in axis_estimator.cpp.
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

    // Forgets everything and begins a new start-up window.
    void begin();

    // Adds a sample of the start-up window.
    void collect(int16_t count) { baseline_.add(count); }

    // Ends the full start-up window and starts the filter.
    void start();

    // Sets Q and R of the filters, which keep their memory. Only call this once there are filters.
    void retune(float Q_dps2, float R_dps2);

    // Processes one sample after the window; null: a lost sample, which is predicted.
    void step(const int16_t* count);

    // Fills in all fields except axis, sample and age.
    void report(Estimate& message) const;

    // Results of the start-up window. They are 0 while it fills; R is also 0 for an axis that never changed.
    float bias_dps() const;
    float r_dps2() const;
    // R in squared counts.
    float variance() const { return filter_ == nullptr ? 0.0f : baseline_.variance(); }

    // Number of restarts by the supervisor since the start-up window.
    uint16_t restarts() const { return restarts_; }

    // Fills in the settings of the filters.
    static void describe(Estimator& message);

  private:
    struct Filter;

    void begin_watch();

    static constexpr size_t kFilterBytes = 448;

    engine::Baseline<int16_t> baseline_;
    engine::Supervisor<float> supervisor_;
    Filter* filter_ = nullptr;  // points to storage_ once the window is full and has given an R
    uint16_t restarts_ = 0;
    bool valid_ = false;
    bool missing_ = false;
    bool tuned_ = false;
    alignas(8) unsigned char storage_[kFilterBytes] = {};
};

}  // namespace fltea
