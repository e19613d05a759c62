// The noise of an axis as the filter that tracks its bias knows it: one system, or two that share the parts
// but differ in how the offset goes on. Each is weighted by how likely it makes the samples, which tell the
// two apart as they come (multiple-model estimation: Bar-Shalom, Li & Kirubarajan, Estimation with
// Applications to Tracking and Navigation, section 11.6.2).
#pragma once

#include <cmath>
#include <vector>

#include "kalman.hpp"
#include "mean_ahead.hpp"
#include "refilter.hpp"

namespace fltea {
namespace track {

class NoiseModel {
  public:
    typedef System<kMost> Noise;
    typedef Kalman<kMost> Filter;
    enum { kRivals = 2 };

    // What changes with the samples.
    struct State {
        std::vector<Filter> filters;
        std::vector<double> unlikely;
    };

    // absolute: the state has no mean of its own, so it holds the offset.
    bool absolute = false;

    // A system, with the bias of the newest sample, and how likely it is; ahead: samples to come for which
    // the bias is meant. False if no filter can work with it. All have as many coordinates.
    bool add(const Noise& system, double weight, std::int64_t ahead) {
        rivals_.emplace_back();
        Rival& one = rivals_.back();
        one.system = system;
        if (!one.map.set(one.system)) return false;
        std::memcpy(one.now, system.bias, sizeof one.now);
        const MeanAhead<kMost> mean = mean_ahead(system, system.bias, ahead);
        std::memcpy(one.system.bias, mean.row, sizeof mean.row);
        one.system.bias_more = mean.variance;
        one.unlikely = -std::log(std::fmax(weight, kLeast));
        return true;
    }
    // Systems stand where they are from here on.
    void start() {
        for (Rival& one : rivals_) one.filter.start(&one.system, &one.map);
        weigh();
        stays_ = rivals_.back().weight;
    }
    // All remembered samples go through the filters, which are as likely as they were before. `tell`: with
    // each of the newest innovations of the likeliest, in its deviations. False if that is no filter.
    template <typename Tell>
    bool filter_again(const Remembered& memory, Tell tell) {
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            Rival& one = rivals_[i];
            if (i == best_) {
                memory.filter_again(one.system, one.map, one.filter, tell);
            } else {
                memory.filter_again(one.system, one.map, one.filter, [](double) {});
            }
            if (!std::isfinite(one.filter.S) || !std::isfinite(one.filter.bias())) return false;
        }
        predict();
        return true;
    }

    int size() const { return likeliest().system.n; }
    const double* x() const { return likeliest().filter.x; }
    int offset() const { return rivals_.front().system.offset(); }
    const Noise& system(std::size_t i) const { return rivals_[i].system; }
    // What the system has of the bias of the newest sample, of each coordinate.
    const double* bias_now(std::size_t i) const { return rivals_[i].now; }
    std::size_t count() const { return rivals_.size(); }
    // Of the innovation of the next sample.
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

    // An innovation in its deviations, for a test of steps: of the offset that does not walk, if that was the
    // likelier one for long. The other one follows a step, and hides it.
    double for_steps(double e) const {
        const Rival& still = rivals_.back();
        return rivals_.size() > 1 && stays_ > 0.5 ? still.e / std::sqrt(still.S) : e / std::sqrt(variance_);
    }
    // A step has explained what the samples since then have said of the two.
    void forget_newest() {
        if (rivals_.size() < 2) return;
        rivals_.front().unlikely = -std::log(std::fmax(1 - stays_, kLeast));
        rivals_.back().unlikely = -std::log(std::fmax(stays_, kLeast));
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

    // e: the innovation of all.
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
    // Of what rows, one for each system, make of x.
    void mean_of(const MeanAhead<kMost>* rows, double& mean, double& variance) const {
        mean = variance = 0;
        for (std::size_t i = 0; i < rivals_.size(); ++i) {
            const Rival& one = rivals_[i];
            const double own = dot(rows[i].row, one.filter.x, one.system.n);
            mean += one.weight * own;
            variance += one.weight * (one.filter.variance_of(rows[i].row) + rows[i].variance + own * own);
        }
        variance = std::fmax(variance - mean * mean, 0);
    }

    // The offset walks by steps of this variance at least, from here on. False if it does, or nothing is
    // left.
    bool raise_walk(double q, std::int64_t ahead) {
        const int i = offset();
        if (i < 0) return false;
        Noise raised = likeliest().system;
        std::memcpy(raised.bias, likeliest().now, sizeof raised.bias);
        double& own = raised.Q[i * raised.n + i];
        if (own >= q) return false;
        own = q;
        std::vector<Rival> before;
        before.swap(rivals_);
        best_ = 0;
        if (add(raised, 1, ahead)) {
            start();
            return true;
        }
        rivals_.swap(before);
        weigh();
        return false;
    }

    // The filters as they are now are those of a chunk ago before long.
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
        std::size_t count = rivals_.size();
        io.number(count, 1, kRivals);
        io.number(absolute, 0, 1);
        io.real(stays_, 0, 1);
        if (!io.sound()) return;
        rivals_.resize(count);
        for (Rival& one : rivals_) {
            one.system.visit(io);
            io.require(one.system.n == rivals_.front().system.n);
            if (io.sound()) io.require(one.map.set(one.system));
            if (!io.sound()) return;
            for (int i = 0; i < one.system.n; ++i) io.real(one.now[i], -1e100, 1e100);
            for (Filter* filter : {&one.filter, &one.before[0], &one.before[1]}) {
                filter->point_to(&one.system, &one.map);
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
            state.filters[i].point_to(&rivals_[i].system, &rivals_[i].map);
            state.filters[i].visit(io);
            io.real(state.unlikely[i], -1e300, 1e300);
        }
    }

  private:
    // Likelier by more than this, by log L, a system is not; it may become the right one.
    static constexpr double kMostLikely = 12, kLeast = 1e-6, kClip = 6, kSlow = 1 / 2048.0;

    struct Rival {
        Noise system = Noise();
        double now[kMost] = {};
        RiccatiMap<kMost> map;
        Filter filter, before[2];
        double e = 0, S = 1, weight = 1;                   // of the newest sample
        double unlikely = 0, unlikely_before[2] = {0, 0};  // -log L, but for a constant
    };

    const Rival& likeliest() const { return rivals_[best_]; }

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

    std::vector<Rival> rivals_;
    std::size_t best_ = 0;
    double variance_ = 1;
    double stays_ = 1;  // weight of the last system, in the mean of the newest few thousand samples
};

}  // namespace track
}  // namespace fltea
