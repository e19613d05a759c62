// What the bias of one axis is now, and how sure that is: the filter of the noise that was found, from a bank
// of walks until it is found, while the sensor is at rest. Nothing depends on how samples are put together.
#pragma once

#include <memory>

#include "past.hpp"
#include "refilter.hpp"
#include "rest_gate.hpp"
#include "walk_bank.hpp"
#include "whiteness.hpp"

namespace fltea {
namespace track {

// After a sample, in its unit; NaN where nothing is known yet. innovation: NaN without a sample.
struct Tracked {
    double state, state_std, bias, bias_std, innovation;
    bool moving;
};

struct TrackerCounts {
    std::uint64_t moved;  // samples in motion
    std::uint64_t begun;  // how often it had to begin again, at an offset that has changed
};

class Tracker {
  public:
    // Lost samples of which more make it begin again.
    enum { kLongestGap = 100000 };
    // Values of no sensor.
    static constexpr double kLargest = 1e100;

    // `offset`: what the sensor adds, if that is given.
    explicit Tracker(const double* offset = nullptr) : fixed_(offset != nullptr) {
        if (fixed_) origin_ = *offset;
        begin_again();
    }

    bool has_system() const { return filter_ != nullptr; }
    // After the newest sample, relative to the origin; no system, no coordinates.
    const double* x() const { return filter_->filter.x; }
    int size() const { return filter_ == nullptr ? 0 : filter_->system.n; }
    double origin() const { return origin_; }
    const TrackerCounts& counts() const { return counts_; }
    const Whiteness& whiteness() const { return white_; }
    bool fixed() const { return fixed_; }

    // From the next sample on this is the noise, and always has been. False, and nothing has changed, if no
    // filter can work with it. `absolute`: its state has no mean of its own, so it holds the offset.
    bool set(const System<kMost>& system, bool absolute) {
        std::unique_ptr<Model> next(new Model);
        next->system = system;
        next->absolute = absolute;
        if (!next->map.set(next->system)) return false;
        refilter::Innovations innovations;
        memory_.filter_again(next->system, next->map, next->filter, &innovations);
        if (!std::isfinite(next->filter.S)) return false;
        gate_.expect(innovations.usual(gate_.usual()));
        if (filter_ == nullptr || filter_->system.n != system.n) white_.skip();
        filter_ = std::move(next);
        banks_.reset();
        keep();
        keep();
        return true;
    }

    const Remembered& memory() const { return memory_; }

    // 2 log L of the samples by the bank, but for a constant, for as long as there is one.
    double likelihood() const {
        return banks_ != nullptr && banks_->bank.knows() ? banks_->bank.likelihood() : __builtin_nan("");
    }

    Tracked next(double y) {
        if (!has_origin_) {
            if (!fixed_) origin_ = y;
            has_origin_ = true;
        }
        const double apart = y - origin_;
        note_change(apart);
        double e = 0, deviation = 1;
        const double z = begin_sample(apart, e, deviation);
        const bool moved = gate_.add(z, apart, deviation);
        if (moved) spiked_ = true;
        const bool moving = gate_.moving() || spiked_;
        go_on(e, !moving);
        if (moving) {
            ++counts_.moved;
            white_.skip();
        } else if (filter_ != nullptr) {
            white_.add(e, std::sqrt(filter_->filter.S));
        }
        memory_.recent[memory_.kept++] = moving ? __builtin_nanf("") : remembered(apart);
        Tracked result = tracked(e, moving);
        end_sample(deviation);
        return result;
    }

    void skip(std::uint64_t count) {
        if (count > 0) white_.skip();
        if (!has_origin_) return;
        if (count > kLongestGap) {
            begin_again();
            return;
        }
        for (std::uint64_t i = 0; i < count; ++i) {
            double e = 0, deviation = 1;
            begin_sample(0, e, deviation);
            go_on(0, false);
            memory_.recent[memory_.kept++] = __builtin_nanf("");
            end_sample(deviation);
        }
    }

    template <typename Io>
    void visit(Io& io) {
        bool has_system = filter_ != nullptr;
        io.number(has_system, 0, 1);
        io.number(has_origin_, 0, 1);
        io.real(origin_, -kLargest, kLargest);
        io.number(spiked_, 0, 1);
        io.number(has_last_, 0, 1);
        io.real(last_, -2 * kLargest, 2 * kLargest);
        io.real(rounding_, 0, 2 * kLargest);
        io.number(memory_.kept, 0, Remembered::kRecent - 1);
        io.number(counts_.moved, 0, 1e15);
        io.number(counts_.begun, 0, 1e15);
        white_.visit(io);
        gate_.visit(io);
        io.require(gate_.fill() == memory_.kept % RestGate::kChunk);
        memory_.past.visit(io);
        for (int i = 0; i < memory_.kept && io.sound(); ++i) visit_known(io, memory_.recent[i]);
        if (!io.sound()) return;
        if (has_system) {
            if (filter_ == nullptr) filter_.reset(new Model);
            banks_.reset();
            visit_model(io);
        } else {
            filter_.reset();
            if (banks_ == nullptr) banks_.reset(new Banks);
            banks_->bank.visit(io);
            for (WalkBank& one : banks_->before) one.visit(io);
        }
    }

  private:
    static constexpr double kRoundings = 3.4641016151377544;  // √12
    struct Model {
        System<kMost> system;
        RiccatiMap<kMost> map;
        Kalman<kMost> filter, before[2];
        bool absolute = false;
    };

    struct Banks {
        WalkBank bank, before[2];
    };

    // Its deviation from what is expected, over the deviation that is expected.
    double begin_sample(double y, double& e, double& deviation) {
        if (filter_ == nullptr) {
            banks_->bank.predict(y);
            e = banks_->bank.innovation();
            deviation = banks_->bank.knows() ? std::sqrt(banks_->bank.variance()) : kLargest;
        } else {
            e = filter_->filter.innovation(y);
            deviation = std::sqrt(filter_->filter.S);
        }
        if (deviation < rounding_) deviation = rounding_;
        return e / deviation;
    }

    // While hardly any sample changes there is still the noise of rounding to the least change.
    void note_change(double y) {
        const double change = std::fabs(y - last_);
        if (change > 0 && has_last_ && (rounding_ == 0 || change < rounding_ * kRoundings)) {
            rounding_ = change / kRoundings;
        }
        last_ = y;
        has_last_ = true;
    }

    void go_on(double e, bool take) {
        if (filter_ == nullptr) {
            banks_->bank.go_on(take);
        } else {
            filter_->filter.go_on(e, take);
        }
    }

    Tracked tracked(double e, bool moving) const {
        if (filter_ == nullptr && !banks_->bank.knows()) {
            const double none = __builtin_nan("");
            return Tracked{none, none, none, none, none, moving};
        }
        const Known known = filter_ == nullptr ? banks_->bank.known() : filter_->filter.known(e);
        const bool absolute = filter_ == nullptr || filter_->absolute;
        return Tracked{known.state + (absolute && !fixed_ ? origin_ : 0),
                       std::sqrt(known.state_variance),
                       known.bias + origin_,
                       std::sqrt(known.bias_variance),
                       e,
                       moving};
    }

    void end_sample(double deviation) {
        const RestGate::Verdict verdict = gate_.next(deviation);
        if (gate_.fill() != 0) return;
        spiked_ = false;
        if (verdict == RestGate::kElsewhere) {
            begin_again();
            ++counts_.begun;
            return;
        }
        if (verdict == RestGate::kBegins) {
            go_back();
            for (float& one : memory_.recent) one = __builtin_nanf("");
        }
        if (memory_.kept < Remembered::kRecent) {
            keep();
            return;
        }
        memory_.past.add(memory_.recent);
        std::memcpy(memory_.recent, memory_.recent + RestGate::kChunk, sizeof(float) * RestGate::kChunk);
        memory_.kept = RestGate::kChunk;
        keep();
    }

    // The filter as it is now is the one of a chunk ago before long.
    void keep() {
        if (filter_ != nullptr) {
            filter_->before[0] = filter_->before[1];
            filter_->before[1] = filter_->filter;
        } else {
            std::swap(banks_->before[0], banks_->before[1]);
            banks_->before[1] = banks_->bank;
        }
    }

    // Motion was seen at the end of a chunk: what it and the one before have done is undone.
    void go_back() {
        if (filter_ != nullptr) {
            filter_->filter = filter_->before[0];
        } else {
            banks_->bank = banks_->before[0];
        }
        for (int i = 0; i < memory_.kept; ++i) {
            double e = 0, deviation = 1;
            begin_sample(0, e, deviation);
            go_on(0, false);
        }
    }

    // With what is known of the noise, if anything is, and nothing of the offset.
    void begin_again() {
        memory_.past.clear();
        memory_.kept = 0;
        spiked_ = false;
        gate_ = RestGate(gate_.usual());
        has_last_ = false;
        if (!fixed_) has_origin_ = false;
        if (filter_ != nullptr) {
            filter_->filter.start(&filter_->system, &filter_->map);
        } else {
            banks_.reset(new Banks);
        }
        keep();
        keep();
    }

    template <typename Io>
    void visit_model(Io& io) {
        Model& m = *filter_;
        System<kMost>& s = m.system;
        io.number(m.absolute, 0, 1);
        s.visit(io);
        if (io.sound()) io.require(m.map.set(s));
        if (!io.sound()) return;
        for (Kalman<kMost>* one : {&m.filter, &m.before[0], &m.before[1]}) {
            one->point_to(&s, &m.map);
            one->visit(io);
        }
    }

    bool fixed_, has_origin_ = false, spiked_ = false, has_last_ = false;
    double origin_ = 0, last_ = 0, rounding_ = 0;
    TrackerCounts counts_ = TrackerCounts();
    RestGate gate_;
    Remembered memory_;
    Whiteness white_;
    std::unique_ptr<Model> filter_;
    std::unique_ptr<Banks> banks_;  // until it is found
};

}  // namespace track
}  // namespace fltea
