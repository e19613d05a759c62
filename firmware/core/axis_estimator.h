// The estimator of one gyroscope axis: start-up window, filter and supervisor. The filter is the same C++
// template as on the host (engine/lane.hpp). Here it works in float, and its memory in integers. The template
// is compiled once, in axis_estimator.cpp.
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

    // Forgets all samples and begins a new start-up window.
    void begin();

    // Adds a sample of the start-up window.
    void collect(int16_t count) { baseline_.add(count); }

    // Ends the full start-up window and starts the filter.
    void start();

    // Sets the filters' variances Q (of a step of the noise) and R (of the white noise). The filters keep
    // their memory. Before start() has made a filter, this function does nothing.
    void retune(float Q_dps2, float R_dps2);

    // Processes one sample after the start-up window. A null pointer means that the sample is lost. The
    // filter then only predicts the sample.
    void step(const int16_t* count);

    // Writes all fields of an ESTIMATE except axis, sample and age.
    void report(Estimate& message) const;

    // The bias and the variance R of the white noise. Both are 0 until the start-up window is full. R is also
    // 0 for an axis whose samples were all equal. retune() changes R.
    float bias_dps() const;
    float r_dps2() const;
    // Variance of the samples in the start-up window, in squared counts, or 0 if there is no filter yet.
    float variance() const { return filter_ == nullptr ? 0.0f : baseline_.variance(); }

    // Number of times that the supervisor has restarted the filter since the start-up window.
    uint16_t restarts() const { return restarts_; }

    // Writes the settings of the filters to an ESTIMATOR message.
    static void describe(Estimator& message);

  private:
    struct Filter;

    void begin_watch();

    static constexpr size_t kFilterBytes = 448;

    engine::Baseline<int16_t> baseline_;
    engine::Supervisor<float> supervisor_;
    // null until the start-up window is full; also null for an axis whose samples were all equal
    Filter* filter_ = nullptr;
    uint16_t restarts_ = 0;
    bool valid_ = false;
    bool missing_ = false;
    bool tuned_ = false;
    alignas(8) unsigned char storage_[kFilterBytes] = {};
};

}  // namespace fltea
