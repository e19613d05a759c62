// A tracker's noise model and its memory of samples as Python objects, which may be used in any thread
// (tracker_model_binding.cpp).
#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <mutex>

#include "axis_tracker.hpp"

// A copy of the samples that the tracker of an axis remembers. The copy never changes.
class RememberedLane {
  public:
    explicit RememberedLane(const fltea::track::AxisTracker& lane)
        : memory_(lane.memory()), steps_(lane.steps()), of_walks_(lane.likelihood()) {}

    const fltea::track::Remembered& memory() const { return memory_; }
    const fltea::track::StepTest& steps() const { return steps_; }
    // 2 log L of the samples if the models of the tracker's bank of filters (walk_bank.hpp) describe them, or
    // NaN if there is no bank.
    double of_walks() const { return of_walks_; }

  private:
    fltea::track::Remembered memory_;
    fltea::track::StepTest steps_;
    double of_walks_;
};

// A noise model for the tracker that will use it, and filters that have already processed the remembered
// samples with this model.
class LaneModel {
  public:
    explicit LaneModel(std::shared_ptr<fltea::track::TrackerModel> model) : model_(std::move(model)) {}

    const std::shared_ptr<fltea::track::TrackerModel>& model() const { return model_; }
    void refilter(const RememberedLane& remembered, int to_come);
    // Returns the prepared filters and gives them away, so only the first call returns them.
    std::unique_ptr<fltea::track::Refiltered> take_refiltered() {
        const std::lock_guard<std::mutex> alone(mutex_);
        return std::move(refiltered_);
    }

  private:
    std::shared_ptr<fltea::track::TrackerModel> model_;
    std::mutex mutex_;
    std::unique_ptr<fltea::track::Refiltered> refiltered_;
};

void bind_tracker_model(nanobind::module_& m);
