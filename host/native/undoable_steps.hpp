// A series of steps of an axis's bias that may be the beginning of motion, so that it may have to be undone.
// The filters' state before the series is stored.
#pragma once

#include <cstdint>
#include <memory>

#include "noise_model.hpp"

namespace fltea {
namespace track {

class UndoableSteps {
  public:
    // What undo() has undone: the newest `samples` samples, among them `steps` steps.
    struct Undone {
        std::int64_t samples;
        std::uint64_t steps;
    };

    bool any() const { return before_ != nullptr; }
    // The bias before the steps. Call this only if there are any.
    double bias() const { return before_->bias; }

    // Appends a step. Call this before the step changes the filters of `model`. `total`: number of all
    // samples so far.
    void add(const NoiseModel& model, std::int64_t total) {
        if (before_ == nullptr) before_.reset(new Before{model.state(), model.bias(), total, total, 0});
        before_->newest = total;
        ++before_->steps;
    }
    // From now on, the steps cannot be undone.
    void forget() { before_.reset(); }
    // Forgets the steps if they were not the beginning of motion, because the newest one is long ago.
    void forget_settled(std::int64_t total) {
        if (before_ != nullptr && total - before_->newest > kSettled) before_.reset();
    }
    // Restores the filters of `model` as they were before the steps. Call this only if there are any.
    Undone undo(NoiseModel& model, std::int64_t total) {
        const Undone found = {total - before_->at, before_->steps};
        model.restore(before_->state);
        before_.reset();
        return found;
    }

    // Saves or loads the steps. Call this only if there are any, or if any are to be loaded. `all`: number of
    // all steps so far.
    template <typename Io>
    void visit(Io& io, NoiseModel& model, std::int64_t total, std::uint64_t all) {
        if (before_ == nullptr) before_.reset(new Before{model.state(), 0, 0, 0, 0});
        Before& one = *before_;
        io.real(one.bias, -1e200, 1e200);
        io.number(one.at, 0, double(total));
        io.number(one.newest, double(one.at), double(total));
        io.number(one.steps, 0, double(all));
        model.visit_state(io, one.state);
    }

  private:
    // If no further step follows within this number of samples, a step was not the beginning of motion.
    enum { kSettled = 512 };

    // State of the filters before the steps.
    struct Before {
        NoiseModel::State state;
        double bias;
        std::int64_t at, newest;  // number of all samples so far: when this was saved, and at the newest step
        std::uint64_t steps;
    };

    std::unique_ptr<Before> before_;
};

}  // namespace track
}  // namespace fltea
