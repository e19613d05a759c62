// The estimator of one gyroscope axis: start-up window, filter and supervisor. The filter is the same
// template as the host's (engine/lane.hpp), here in float and with a memory in integers. It is compiled once,
// in axis_estimator.cpp.
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

    // Sets Q and R of the filters, which keep their memory. Call this only after start() has made a filter.
    void retune(float Q_dps2, float R_dps2);

    // Processes one sample after the start-up window. With null instead of a sample, the sample is lost and
    // the filter predicts it.
    void step(const int16_t* count);

    // Fills in all fields of an ESTIMATE except axis, sample and age.
    void report(Estimate& message) const;

    // Bias and R from the start-up window. Both are 0 until the window is full; R is also 0 for an axis whose
    // samples were all equal.
    float bias_dps() const;
    float r_dps2() const;
    // Variance R of the white noise, in squared counts.
    float variance() const { return filter_ == nullptr ? 0.0f : baseline_.variance(); }

    // Number of restarts by the supervisor since the start-up window.
    uint16_t restarts() const { return restarts_; }

    // Fills the settings of the filters into an ESTIMATOR.
    static void describe(Estimator& message);

  private:
    struct Filter;

    void begin_watch();

    static constexpr size_t kFilterBytes = 448;

    engine::Baseline<int16_t> baseline_;
    engine::Supervisor<float> supervisor_;
    Filter* filter_ = nullptr;  // null until the start-up window is full and has given an R
    uint16_t restarts_ = 0;
    bool valid_ = false;
    bool missing_ = false;
    bool tuned_ = false;
    alignas(8) unsigned char storage_[kFilterBytes] = {};
};

}  // namespace fltea
