// Filters the samples of one axis: with the filters of its noise model (noise_model.hpp), or, until there is
// a model, with a bank of filters for typical noises (walk_bank.hpp).
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "noise_model.hpp"
#include "walk_bank.hpp"

namespace fltea {
namespace track {

class AxisFilter {
  public:
    // `ahead`: the bias is the expected mean over this number of next samples.
    explicit AxisFilter(std::int64_t ahead) : ahead_(ahead) {}

    bool has_model() const { return model_ != nullptr; }
    // The filters of the noise model. Call this only if has_model() is true.
    NoiseModel& model() { return *model_; }
    const NoiseModel& model() const { return *model_; }
    // The filters for typical noises, which exist only until there is a noise model. Call this only if
    // has_model() is false.
    WalkBank& bank() { return banks_->now; }
    const WalkBank& bank() const { return banks_->now; }

    // Filters with a noise model from now on.
    void use(std::unique_ptr<NoiseModel> model) {
        model_ = std::move(model);
        banks_.reset();
        keep_twice();
    }
    // Starts the filters again. They keep the noise model.
    void start() {
        if (model_ == nullptr) {
            start_bank();
            return;
        }
        model_->start();
        keep_twice();
    }
    void start_bank() {
        banks_.reset(new Banks(ahead_));
        keep_twice();
    }

    // Starts the bank of filters with these samples. Unknown samples are NaN.
    void start_bank_with(const std::vector<double>& samples) {
        start_bank();
        for (const double y : samples) {
            banks_->now.predict(std::isnan(y) ? 0 : y);
            banks_->now.go_on(!std::isnan(y));
        }
    }

    // Takes the sample `y`, from which the axis's origin (AxisTracker) was subtracted. Call go_on()
    // afterwards.
    void predict(double y) {
        if (model_ == nullptr) {
            banks_->now.predict(y);
            e_ = banks_->now.innovation();
        } else {
            e_ = model_->innovation(y);
        }
    }
    // Advances by the sample that predict() took. If `take` is false, the sample says nothing about the
    // state.
    void go_on(bool take) {
        if (model_ == nullptr) {
            banks_->now.go_on(take);
        } else {
            model_->go_on(take);
        }
    }

    // Whether there are estimates. A bank of filters has none for its first samples.
    bool knows() const { return model_ != nullptr || banks_->now.knows(); }
    // The innovation of the newest sample.
    double innovation() const { return e_; }
    // Variance of the innovation of the next sample.
    double variance() const { return model_ == nullptr ? banks_->now.variance() : model_->variance(); }
    Known known() const { return model_ == nullptr ? banks_->now.known() : model_->known(e_); }
    // The present bias minus the origin, because predict() takes samples from which the origin was
    // subtracted.
    double bias() const {
        if (model_ != nullptr) return model_->bias();
        return banks_->now.knows() ? banks_->now.known().bias : 0;
    }
    // State vector after the newest sample. Without a model the vector is empty.
    const double* x() const { return model_->x(); }
    int size() const { return model_ == nullptr ? 0 : model_->size(); }

    // Stores a copy of the filters at the end of a chunk. When the next chunk has ended, this copy has the
    // filters as they were one chunk earlier.
    void keep() {
        if (model_ != nullptr) {
            model_->keep();
        } else {
            std::swap(banks_->before[0], banks_->before[1]);
            banks_->before[1] = banks_->now;
        }
    }
    void keep_twice() {
        keep();
        keep();
    }
    // Restores the filters as they were one chunk earlier.
    void go_back() {
        if (model_ != nullptr) {
            model_->go_back();
        } else {
            banks_->now = banks_->before[0];
        }
    }

    template <typename Io>
    void visit(Io& io, bool has_model) {
        if (has_model) {
            if (model_ == nullptr) model_.reset(new NoiseModel);
            banks_.reset();
            model_->visit(io);
        } else {
            model_.reset();
            if (banks_ == nullptr) banks_.reset(new Banks(ahead_));
            banks_->now.visit(io);
            for (WalkBank& one : banks_->before) one.visit(io);
        }
    }

  private:
    struct Banks {
        explicit Banks(std::int64_t ahead) : now(ahead), before{now, now} {}
        WalkBank now, before[2];
    };

    std::int64_t ahead_;
    double e_ = 0;
    std::unique_ptr<NoiseModel> model_;
    std::unique_ptr<Banks> banks_;  // null as soon as there is a noise model
};

}  // namespace track
}  // namespace fltea
