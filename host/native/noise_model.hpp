// The Kalman filters for the noise of an axis (tracker_model.hpp). There is one filter for one noise system,
// or there are two for two candidate systems. Each filter is weighted by the likelihood that its system gives
// to the samples, so that the weights change with the samples (multiple-model estimation: Bar-Shalom, Li &
// Kirubarajan, Estimation with Applications to Tracking and Navigation, section 11.6.2).
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "kalman.hpp"
#include "refiltered.hpp"
#include "tracker_model.hpp"

namespace fltea {
namespace track {

class NoiseModel {
  public:
    typedef System<kMost> Noise;
    typedef Kalman<kMost> Filter;

    // Everything that changes with the samples. A copy of it can be stored and restored.
    struct State {
        std::vector<Filter> filters;
        std::vector<double> unlikely;
    };

    // If the object is constructed without a model, it can be used only after a saved model was loaded into
    // it.
    explicit NoiseModel(const std::shared_ptr<TrackerModel>& of = nullptr) : of_(of) {
        if (of == nullptr) return;
        rivals_.resize(of->count());
        for (std::size_t i = 0; i < rivals_.size(); ++i) rivals_[i].unlikely = of->rival(i).unlikely;
        weigh();
        stays_ = rivals_.back().weight;
    }
    // Starts all filters. They then know nothing about the offset, the state that may step.
    void start() {
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            rivals_[i].filter.start(&of_->rival(i).system, &of_->rival(i).map);
        }
        weigh();
        stays_ = rivals_.back().weight;
    }
    void go_on_from(const Refiltered& filtered) {
        for (std::size_t i = 0; i < rivals_.size(); ++i) rivals_[i].filter = filtered.filter(i);
        predict();
    }
    // Filters all remembered samples again with each system. The weights of the systems stay the same.
    void filter_again(const Remembered& memory) {
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            memory.filter_again(of_->rival(i).system, of_->rival(i).map, rivals_[i].filter);
        }
        predict();
    }

    const TrackerModel& model() const { return *of_; }
    int size() const { return of_->rival(best_).system.n; }
    const double* x() const { return rivals_[best_].filter.x; }
    int offset() const { return of_->rival(0).system.offset(); }
    // Variance of the innovation of the next sample.
    double variance() const { return variance_; }

    double innovation(double y) {
        double e = 0;
        for (Rival& one : rivals_) {
            one.e = one.filter.innovation(y);
            one.S = one.filter.S;
            e += one.weight * one.e;
        }
        return e;
    }

    // Returns the innovation that the test for steps of the bias uses, divided by its standard deviation.
    // `e`: the weighted mean of the innovations of all systems.
    //
    // Normally, that is `e`. But if the system whose offset does no random walk has been the more likely one
    // for long, it is this system's innovation. The offset of the other system follows a step, so that the
    // innovations of that system hardly show the step.
    double for_steps(double e) const {
        const Rival& still = rivals_.back();
        return rivals_.size() > 1 && stays_ > 0.5 ? still.e / std::sqrt(still.S) : e / std::sqrt(variance_);
    }
    // Resets the weights of the two systems to their mean over the newest few thousand samples. Call this
    // when a step was detected: the last few samples are explained by the step, so they do not show which
    // system is likelier.
    void forget_newest() {
        if (rivals_.size() < 2) return;
        rivals_.front().unlikely = TrackerModel::unlikely(1 - stays_);
        rivals_.back().unlikely = TrackerModel::unlikely(stays_);
        weigh();
        predict();
    }

    void go_on(bool take) {
        const bool judged = take && rivals_.size() > 1;
        for (Rival& one : rivals_) {
            if (judged) {
                const double S = one.filter.S, square = std::fmin(one.e * one.e / S, kClip * kClip);
                one.unlikely += 0.5 * (square + std::log(S));
            }
            one.filter.go_on(one.e, take);
        }
        if (judged) {
            weigh();
            stays_ += kSlow * (rivals_.back().weight - stays_);
        }
        predict();
    }

    // Returns the weighted mean of the estimates of all systems. `e`: the weighted mean of their innovations.
    Known known(double e) const {
        if (rivals_.size() == 1) return rivals_.front().filter.known(e);
        Known all = Known{0, 0, 0, 0, e, variance_};
        for (const Rival& one : rivals_) {
            const Known own = one.filter.known(one.e);
            all.state += one.weight * own.state;
            all.bias += one.weight * own.bias;
            all.state_variance += one.weight * (own.state_variance + own.state * own.state);
            all.bias_variance += one.weight * (own.bias_variance + own.bias * own.bias);
        }
        all.state_variance = std::fmax(all.state_variance - all.state * all.state, 0);
        all.bias_variance = std::fmax(all.bias_variance - all.bias * all.bias, 0);
        return all;
    }
    double bias() const {
        double sum = 0;
        for (const Rival& one : rivals_) sum += one.weight * one.filter.bias();
        return sum;
    }
    // Computes mean and variance of a quantity that is a linear function of the state x. `rows` has the
    // coefficients of this function for each system.
    void mean_of(const MeanAhead<kMost>* rows, double& mean, double& variance) const {
        mean = variance = 0;
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            const Rival& one = rivals_[i];
            const double own = dot(rows[i].row, one.filter.x, of_->rival(i).system.n);
            mean += one.weight * own;
            variance += one.weight * (one.filter.variance_of(rows[i].row) + rows[i].variance + own * own);
        }
        variance = std::fmax(variance - mean * mean, 0);
    }

    // Replaces the model by its likelier system alone, in which the offset does a random walk with larger
    // steps, of variance `q`, and starts the filter. Returns false and changes nothing if there is no such
    // offset, if its steps have this variance or more already, or if no filter can work with the changed
    // system.
    bool raise_walk(double q, const BiasLengths& lengths) {
        const int i = offset();
        if (i < 0) return false;
        Noise raised = of_->rival(best_).system;
        std::memcpy(raised.bias, of_->rival(best_).now, sizeof raised.bias);
        double& own = raised.Q[i * raised.n + i];
        if (own >= q) return false;
        own = q;
        const std::shared_ptr<TrackerModel> next =
            TrackerModel::made({raised}, {1.0}, of_->absolute(), lengths);
        if (next == nullptr) return false;
        *this = NoiseModel(next);
        start();
        return true;
    }

    // Stores a copy of the present filters. The copy that was stored by the previous call is kept, too.
    void keep() {
        for (Rival& one : rivals_) {
            one.before[0] = one.before[1];
            one.before[1] = one.filter;
            one.unlikely_before[0] = one.unlikely_before[1];
            one.unlikely_before[1] = one.unlikely;
        }
    }
    void go_back() {
        for (Rival& one : rivals_) {
            one.filter = one.before[0];
            one.unlikely = one.unlikely_before[0];
        }
        weigh();
        predict();
    }

    State state() const {
        State found;
        for (const Rival& one : rivals_) {
            found.filters.push_back(one.filter);
            found.unlikely.push_back(one.unlikely);
        }
        return found;
    }
    void restore(const State& from) {
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            rivals_[i].filter = from.filters[i];
            rivals_[i].unlikely = from.unlikely[i];
        }
        weigh();
        predict();
    }

    template <typename Io>
    void visit(Io& io) {
        if (Io::kLoads) of_ = std::make_shared<TrackerModel>();
        of_->visit_beginning(io);
        io.real(stays_, 0, 1);
        if (!io.sound()) return;
        rivals_.resize(of_->count());
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            Rival& one = rivals_[i];
            of_->visit_rival(io, i);
            if (!io.sound()) return;
            for (Filter* filter : {&one.filter, &one.before[0], &one.before[1]}) {
                filter->point_to(&of_->rival(i).system, &of_->rival(i).map);
                filter->visit(io);
            }
            for (double* x : {&one.unlikely, &one.unlikely_before[0], &one.unlikely_before[1]}) {
                io.real(*x, -1e300, 1e300);
            }
            io.real(one.e, -1e200, 1e200);
            io.real(one.S, 1e-300, 1e300);
        }
        if (!io.sound()) return;
        weigh();
        predict();
    }
    template <typename Io>
    void visit_state(Io& io, State& state) {
        state.filters.resize(rivals_.size());
        state.unlikely.resize(rivals_.size());
        for (std::size_t i = 0; i < rivals_.size() && io.sound(); ++i) {
            state.filters[i].point_to(&of_->rival(i).system, &of_->rival(i).map);
            state.filters[i].visit(io);
            io.real(state.unlikely[i], -1e300, 1e300);
        }
    }

  private:
    // kMostLikely: largest difference between the log likelihoods of two systems. A larger difference is
    // reduced to this. The less likely system can therefore soon become the likelier one again.
    static constexpr double kMostLikely = 12, kClip = 6, kSlow = 1 / 2048.0;

    struct Rival {
        Filter filter, before[2];
        // `e`: innovation of this system's filter at the newest sample. `S`: variance of that innovation.
        // `weight`: weight of this system among the candidates
        double e = 0, S = 1, weight = 1;
        // -log L of the samples if this system describes them, up to a constant
        double unlikely = 0, unlikely_before[2] = {0, 0};
    };

    void weigh() {
        best_ = 0;
        for (std::size_t i = 1; i < rivals_.size(); ++i) {
            if (rivals_[i].unlikely < rivals_[best_].unlikely) best_ = i;
        }
        double all = 0;
        const double least = rivals_[best_].unlikely;
        for (Rival& one : rivals_) {
            one.unlikely = std::fmin(one.unlikely - least, kMostLikely);
            one.weight = std::exp(-one.unlikely);
            all += one.weight;
        }
        for (Rival& one : rivals_) one.weight /= all;
    }

    void predict() {
        variance_ = 0;
        for (const Rival& one : rivals_) variance_ += one.weight * one.filter.S;
    }

    std::shared_ptr<TrackerModel> of_;
    std::vector<Rival> rivals_;
    std::size_t best_ = 0;
    double variance_ = 1;
    // weight of the last candidate system, whose offset does no random walk: mean over the newest few
    // thousand samples
    double stays_ = 1;
};

}  // namespace track
}  // namespace fltea
