// The filters of a new noise model after they have processed all remembered samples of an axis. This work may
// be done in any thread, on a copy of the remembered samples. It is assumed that `to_come` more samples will
// have come when the tracker begins to use the model. The tracker then has to filter only these samples. The
// results are bit-identical to those of filtering everything in the tracker.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "remembered.hpp"
#include "step_test.hpp"
#include "tracker_model.hpp"

namespace fltea {
namespace track {

class Refiltered {
  public:
    // Largest number of samples that may come while the copied samples are filtered. The memory keeps the
    // newest Past::kSingle samples singly, and averages older ones. If no more than kMostToCome samples have
    // come, the newest copied samples are still kept singly.
    enum { kMostToCome = Past::kSingle / 2 };

    // `steps`: a step test with the statistics of the innovations so far. `to_come`: number of samples that
    // will come until go_on() is called.
    Refiltered(const std::shared_ptr<TrackerModel>& model, const Remembered& memory, const StepTest& steps,
               int to_come)
        : model_(model), filters_(model->count()), then_(memory), steps_(steps), to_come_(to_come) {
        steps_.clear();
        steps_.relearn();
        for (int i = 0; i < to_come; ++i) then_.foresee();
        refilter::Likelihood fits;
        for (std::size_t i = 0; i < filters_.size(); ++i) {
            then_.filter_means(model->rival(i).system, model->rival(i).map, filters_[i], fits);
        }
        take(then_, 0, then_.singles() - to_come);
    }

    const std::shared_ptr<TrackerModel>& model() const { return model_; }
    // Whether the tracker's `memory` has the samples that were filtered here, and after them exactly
    // `to_come` newer samples. The values of the newer samples do not matter.
    bool expects(const Remembered& memory) const { return then_.is(memory, to_come_); }
    // Filters the `to_come` samples that came after those that the constructor has filtered.
    void go_on(const Remembered& memory) { take(memory, memory.singles() - to_come_, memory.singles()); }

    // Whether the filters have only valid numbers. Call this after go_on().
    bool sound() const {
        for (const Kalman<kMost>& one : filters_) {
            if (!std::isfinite(one.S) || !std::isfinite(one.bias())) return false;
        }
        return true;
    }
    const Kalman<kMost>& filter(std::size_t i) const { return filters_[i]; }
    const StepTest& steps() const { return steps_; }
    Usual usual(const Usual& before) { return innovations_.usual(before); }

  private:
    void take(const Remembered& memory, int begin, int end) {
        refilter::Likelihood fits;
        for (std::size_t i = 0; i < filters_.size(); ++i) {
            const System<kMost>& system = model_->rival(i).system;
            if (i == model_->likeliest()) {
                memory.filter_single(system, filters_[i], begin, end, fits, [this](double z) {
                    innovations_.add(z);
                    if (!std::isnan(z)) steps_.take(z);
                });
            } else {
                memory.filter_single(system, filters_[i], begin, end, fits, [](double) {});
            }
        }
    }

    std::shared_ptr<TrackerModel> model_;
    std::vector<Kalman<kMost>> filters_;
    Remembered then_;
    refilter::Innovations innovations_;
    StepTest steps_;
    int to_come_;
};

}  // namespace track
}  // namespace fltea
