// The noise model that an axis's tracker uses: one system, or two candidate systems with the same noise parts
// but different behaviour of the offset. This class has everything that follows from the systems alone,
// without samples: how the covariances of their filters advance, and how the bias is forecast. An object
// never changes once it is made, so any thread may make it, and all filters may share it.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "linear_system.hpp"
#include "mean_ahead.hpp"

namespace fltea {
namespace track {

// Numbers of samples over which the bias is defined and checked. `ahead`: The bias is the expected mean over
// this number of future samples. If `ahead` is 0, it is the bias of the newest sample. `checked`: lengths
// over which the bias is checked (bias_check.hpp). If a length is 0, there is no check.
struct BiasLengths {
    enum { kChecks = 3 };
    std::int64_t ahead = 0;
    std::int64_t checked[kChecks] = {0, 0, 0};
};

class TrackerModel {
  public:
    typedef System<kMost> Noise;
    enum { kRivals = 2 };

    struct Rival {
        // the candidate system; the expected mean of the bias over the next `ahead` samples is a weighted sum
        // of the states, and the system's member `bias` has the weights
        Noise system = Noise();
        double now[kMost] = {};  // weight of each state in the bias of the newest sample
        RiccatiMap<kMost> map;
        // negative logarithm of the probability of the system
        double unlikely = 0;
        // forecasts of the means of the bias over the next `BiasLengths::checked` samples, with which the
        // bias is checked
        MeanAhead<kMost> checked[BiasLengths::kChecks] = {};
    };

    // `absolute`: whether the published state includes the origin, which is a value that is subtracted from
    // all samples. It has to be true if the state includes a random walk, because a random walk has no fixed
    // mean.
    explicit TrackerModel(bool absolute = false) : absolute_(absolute) {}

    // Makes the model from `systems`, which must have the same number of states. Returns null if no filter
    // can work with them. `weights`: the probabilities of the systems.
    static std::shared_ptr<TrackerModel> made(const std::vector<Noise>& systems,
                                              const std::vector<double>& weights, bool absolute,
                                              const BiasLengths& lengths) {
        std::shared_ptr<TrackerModel> found = std::make_shared<TrackerModel>(absolute);
        found->lengths_ = lengths;
        found->rivals_.reserve(systems.size());
        for (std::size_t i = 0; i < systems.size(); ++i) {
            if (!found->add(systems[i], weights[i])) return nullptr;
        }
        return found;
    }

    bool absolute() const { return absolute_; }
    std::size_t count() const { return rivals_.size(); }
    const Rival& rival(std::size_t i) const { return rivals_[i]; }
    const BiasLengths& lengths() const { return lengths_; }
    // Samples are the bias plus noise. This is the spectral density of that noise at frequency 0. In the mean
    // of n samples, the noise has the variance density() / n.
    double density() const { return density_; }
    std::size_t likeliest() const {
        std::size_t best = 0;
        for (std::size_t i = 1; i < rivals_.size(); ++i) {
            if (rivals_[i].unlikely < rivals_[best].unlikely) best = i;
        }
        return best;
    }

    static double unlikely(double weight) { return -std::log(std::fmax(weight, kLeast)); }

    // Loads or saves (depending on the type of `io`) the numbers of the model that come before those of its
    // systems. visit_rival() loads or saves one of the candidate systems. The forecasts for the bias checks
    // are saved elsewhere, together with the results of these checks.
    template <typename Io>
    void visit_beginning(Io& io) {
        std::size_t count = rivals_.size();
        io.number(count, 1, kRivals);
        io.number(absolute_, 0, 1);
        if (io.sound() && Io::kLoads) rivals_.resize(count);
    }
    template <typename Io>
    void visit_rival(Io& io, std::size_t i) {
        Rival& one = rivals_[i];
        one.system.visit(io);
        io.require(one.system.n == rivals_.front().system.n);
        if (io.sound() && Io::kLoads) io.require(one.map.set(one.system));
        if (!io.sound()) return;
        for (int k = 0; k < one.system.n; ++k) io.real(one.now[k], -1e100, 1e100);
    }

  private:
    static constexpr double kLeast = 1e-6;

    bool add(const Noise& system, double weight) {
        rivals_.emplace_back();
        Rival& one = rivals_.back();
        one.system = system;
        if (!one.map.set(one.system)) return false;
        std::memcpy(one.now, system.bias, sizeof one.now);
        const MeanAhead<kMost> mean = mean_ahead(system, system.bias, lengths_.ahead);
        std::memcpy(one.system.bias, mean.row, sizeof mean.row);
        one.system.bias_more = mean.variance;
        one.unlikely = unlikely(weight);
        bool noise[kMost] = {};
        for (int k = 0; k < system.n; ++k) noise[k] = one.now[k] == 0;
        density_ = std::fmax(density_, system.R + density_at_zero(one.system, noise));
        for (int k = 0; k < BiasLengths::kChecks; ++k) {
            one.checked[k] = mean_ahead(one.system, one.now, lengths_.checked[k]);
        }
        return true;
    }

    bool absolute_;
    BiasLengths lengths_;
    std::vector<Rival> rivals_;
    double density_ = 0;
};

}  // namespace track
}  // namespace fltea
