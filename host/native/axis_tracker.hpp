// Tracks the present bias of one axis and its standard deviation while the sensor is at rest. The tracker
// uses the filter of the fitted noise model; until there is a model, it uses a bank of random-walk filters.
// Rest and motion are decided for all axes together (sensor_tracker.hpp). Results do not depend on how
// samples are grouped into calls.
#pragma once

#include <limits>
#include <memory>

#include "bias_check.hpp"
#include "past.hpp"
#include "remembered.hpp"
#include "rest_gate.hpp"
#include "step_test.hpp"
#include "walk_bank.hpp"
#include "whiteness.hpp"

namespace fltea {
namespace track {

// Estimate after a sample, in the unit of the sample; NaN where nothing is known yet. `innovation` is NaN
// without a sample.
struct Tracked {
    double state, state_std, bias, bias_std, innovation;
    bool moving;
};

struct TrackerCounts {
    std::uint64_t moved;  // number of samples in motion
    std::uint64_t begun;  // number of restarts, because the offset had changed
    std::uint64_t steps;  // number of steps of the bias
};

struct TrackerRules : BiasLengths {
    // Largest step of the bias. A larger change is taken for motion.
    double largest_step = std::numeric_limits<double>::infinity();
    // Number of samples that have to lie still at another level until the tracker accepts that level as the
    // new offset. `still` applies if the level is nearer to 0, the caller reports rest, or `settles` is set;
    // otherwise the sensor may turn, and `patience` applies.
    std::int64_t still = 1024, patience = 60000;
    // Whether a level farther from 0 counts as a possible offset, too, although it may be a turn.
    bool settles = true;
};

// A step of the bias. The newest `ago` samples came after the step.
struct BiasStep {
    std::int64_t ago;
    double size, size_std;
};

class AxisTracker {
  public:
    // A longer gap of lost samples restarts the tracker.
    enum { kLongestGap = 100000 };
    // Larger in magnitude than any sensor value.
    static constexpr double kLargest = 1e100;

    // `offset`: the known offset of the sensor, or null if it is to be tracked.
    AxisTracker(const TrackerRules& rules, const double* offset) : rules_(rules), fixed_(offset != nullptr) {
        if (fixed_) origin_ = *offset;
        for (int i = 0; i < BiasCheck::kTimes; ++i) check_.expect(i, rules.checked[i]);
        begin_again();
    }

    // Whether a sample has arrived.
    bool has_begun() const { return has_origin_; }
    // State vector of the likeliest system after the newest sample, relative to the origin. Without a model
    // its size is 0.
    const double* x() const { return model_->x(); }
    int size() const { return model_ == nullptr ? 0 : model_->size(); }
    double origin() const { return origin_; }
    const TrackerCounts& counts() const { return counts_; }
    const Whiteness& whiteness() const { return white_; }
    const BiasCheck& check() const { return check_; }
    const Remembered& memory() const { return memory_; }
    bool fixed() const { return fixed_; }

    // Sets the noise model, which then applies from the next sample on, and to all remembered samples.
    // Returns false and changes nothing if no filter can work with the model. `begun`: a filter that has
    // already processed the remembered samples in another thread, or null. The remembered samples are
    // filtered here if `begun` is null, or if it no longer matches the memory.
    bool set(const std::shared_ptr<TrackerModel>& model, Refiltered* begun = nullptr) {
        std::unique_ptr<Refiltered> own;
        if (begun == nullptr || begun->model() != model || !begun->expects(memory_)) {
            own.reset(new Refiltered(model, memory_, steps_, 0));
            begun = own.get();
        }
        begun->go_on(memory_);
        if (!begun->sound()) return false;
        std::unique_ptr<NoiseModel> next(new NoiseModel(model));
        next->go_on_from(*begun);
        gate_.expect(begun->usual(gate_.usual()));
        if (model_ == nullptr || model_->size() != next->size()) white_.skip();
        steps_ = begun->steps();
        model_ = std::move(next);
        banks_.reset();
        before_.reset();
        check_.set(*model);
        keep_twice();
        return true;
    }
    const StepTest& steps() const { return steps_; }

    // Returns 2 log L of the samples under the bank, up to a constant; NaN without a bank.
    double likelihood() const {
        return banks_ != nullptr && banks_->bank.knows() ? banks_->bank.likelihood() : __builtin_nan("");
    }

    // Predicts a sample. Returns true if this sample alone shows motion. Call `take` afterwards.
    bool predict(double y) {
        if (!has_origin_) {
            if (!fixed_) origin_ = y;
            has_origin_ = true;
        }
        apart_ = y - origin_;
        if (apart_ != last_ && has_last_ && has_slept()) wake(y);
        note_change(apart_);
        const double z = begin_sample(apart_);
        return gate_.add(z, apart_, deviation_);
    }

    Tracked take(bool moving) {
        go_on(!moving);
        seen_ = StepSeen{StepSeen::kNothing, 0, 0};
        if (moving) {
            ++counts_.moved;
            white_.skip();
            check_.skip();
        } else {
            if (model_ != nullptr) {
                white_.add(e_, std::sqrt(model_->variance()));
                check_.add(*model_, apart_);
            }
            if (!fixed_ && deviation_ < kLargest) seen_ = steps_.add(for_steps_);
        }
        memory_.add(moving ? __builtin_nanf("") : remembered(apart_));
        return tracked(moving);
    }

    // Bridges one missing sample by prediction.
    void miss() {
        white_.skip();
        check_.skip();
        begin_sample(0);
        go_on(false);
        memory_.add(__builtin_nanf(""));
    }

    // After a sample: whether the step test has detected a change of the bias.
    StepSeen::Kind seen() const { return seen_.kind; }
    // Whether the suspected step would move the bias farther from its settled value than a step can.
    bool is_too_far() const { return !(std::fabs(bias() + step_size() - settled_bias()) <= largest_step()); }

    // Accepts the detected step: the bias becomes that of the samples since then. Returns false if it is no
    // step after all.
    bool step(BiasStep& found) {
        const StepSeen seen = seen_;
        const double was = bias(), was_variance = bias_variance(), size = step_size();
        if (seen.kind == StepSeen::kDrift || goes_on(seen, size)) {
            drift(seen, size);
            return false;
        }
        last_step_ = LastStep{memory_.total, size};
        if (model_ == nullptr) return begin_bank_at(seen.ago, size, was, was_variance, found);
        if (model_->offset() < 0) {
            steps_.clear();
            return false;
        }
        note_before();
        model_->forget_newest();
        memory_.steps.add(memory_.total - seen.ago, kWide * size * size);
        again();
        return told(BiasStep{seen.ago, bias() - was, std::sqrt(bias_variance() + was_variance)}, found);
    }

    // Judges the chunk at its end. Call this before `roll`.
    ChunkVerdict end_chunk(bool moving) {
        return gate_.end_chunk(deviation_, settled_bias(), largest_step(), moving);
    }

    void drop_chunk() { gate_.drop_chunk(); }

    // Motion was detected: undoes what this chunk and the chunk before have changed, and the steps that
    // preceded the motion. Returns the number of samples that were undone.
    std::int64_t go_back() {
        steps_.clear();
        check_.skip();
        if (before_ != nullptr) {
            const std::int64_t count = memory_.total - before_->at;
            counts_.steps -= before_->steps;
            model_->restore(before_->state);
            memory_.forget(int(count < int(Past::kSingle) ? count : int(Past::kSingle)));
            before_.reset();
            predict_over(count);
            return count;
        }
        memory_.forget(memory_.kept);
        if (model_ != nullptr) {
            model_->go_back();
        } else {
            banks_->bank = banks_->before[0];
        }
        const int count = memory_.kept;
        predict_over(count);
        return count;
    }

    // The caller announces that motion begins with the next sample.
    void pause() {
        steps_.clear();
        check_.skip();
        before_.reset();
    }

    // Ends a chunk.
    void roll() {
        if (before_ != nullptr && memory_.total - before_->newest > kSettled) before_.reset();
        memory_.roll();
        keep();
    }

    // Restarts the tracker. Keeps what is known of the noise, and forgets the offset.
    void begin_again() {
        memory_.clear();
        const Usual usual = gate_.usual();
        gate_ = RestGate();
        gate_.expect(usual);
        steps_.clear();
        check_.skip();
        before_.reset();
        last_step_ = LastStep{0, 0};
        has_last_ = false;
        if (!fixed_) has_origin_ = false;
        if (model_ != nullptr) {
            model_->start();
        } else {
            banks_.reset(new Banks(rules_.ahead));
        }
        keep_twice();
    }
    void count_beginning() { ++counts_.begun; }

    // Distance of the last sample from the settled bias.
    double off() const { return std::fabs(apart_ - settled_bias()); }
    // Present bias, as it is published.
    double absolute_bias() const { return bias() + origin_; }

    template <typename Io>
    void visit(Io& io) {
        bool has_model = model_ != nullptr, has_before = before_ != nullptr;
        io.number(has_model, 0, 1);
        io.number(has_before, 0, 1);
        io.number(has_origin_, 0, 1);
        io.real(origin_, -kLargest, kLargest);
        io.number(has_last_, 0, 1);
        io.real(last_, -2 * kLargest, 2 * kLargest);
        io.real(rounding_, 0, 2 * kLargest);
        io.real(deviation_, 0, 2 * kLargest);
        io.number(counts_.moved, 0, 1e15);
        io.number(counts_.begun, 0, 1e15);
        io.number(counts_.steps, 0, 1e15);
        io.number(last_step_.at, 0, 1e15);
        io.real(last_step_.size, -2 * kLargest, 2 * kLargest);
        white_.visit(io);
        gate_.visit(io);
        steps_.visit(io);
        check_.visit(io);
        memory_.visit(io);
        if (!io.sound()) return;
        if (has_model) {
            if (model_ == nullptr) model_.reset(new NoiseModel);
            banks_.reset();
            model_->visit(io);
            if (!has_before) before_.reset();
            if (has_before && io.sound()) visit_before(io);
        } else {
            io.require(!has_before);
            model_.reset();
            before_.reset();
            if (banks_ == nullptr) banks_.reset(new Banks(rules_.ahead));
            banks_->bank.visit(io);
            for (WalkBank& one : banks_->before) one.visit(io);
        }
    }

  private:
    static constexpr double kRoundings = 3.4641016151377544;  // √12
    // kWide: prior variance of a step, as a multiple of its squared apparent size. kSettled: number of
    // samples without a further step after which a step cannot have been the beginning of motion.
    static constexpr double kWide = 10, kLeastOfNoise = 2;
    enum { kSettled = 512, kFewestOfBank = 1024, kSlow = 1024, kSoon = 4, kBefore = 512 };

    struct Banks {
        explicit Banks(std::int64_t ahead) : bank(ahead), before{bank, bank} {}
        WalkBank bank, before[2];
    };

    struct LastStep {
        std::int64_t at;  // number of samples when the step was reported
        double size;
    };

    // State of the filter before the first of the newest steps, which may be the beginning of motion.
    struct Before {
        NoiseModel::State state;
        double bias;
        std::int64_t at, newest;  // number of samples when this was saved, and at the newest step
        std::uint64_t steps;
    };

    // Returns the innovation of `y`, divided by its expected deviation.
    double begin_sample(double y) {
        if (model_ == nullptr) {
            banks_->bank.predict(y);
            e_ = banks_->bank.innovation();
            deviation_ = banks_->bank.knows() ? std::sqrt(banks_->bank.variance()) : kLargest;
        } else {
            e_ = model_->innovation(y);
            deviation_ = std::sqrt(model_->variance());
        }
        const double z = model_ == nullptr ? e_ / deviation_ : model_->for_steps(e_);
        for_steps_ = deviation_ < rounding_ ? z * deviation_ / rounding_ : z;
        if (deviation_ < rounding_) deviation_ = rounding_;
        return e_ / deviation_;
    }

    // Whether no sample has changed so far. Then the noise cannot be estimated.
    bool has_slept() const {
        return model_ == nullptr && banks_->bank.knows() && !(banks_->bank.variance() > kNothing);
    }

    // Handles the first change of the samples. The constant samples before it say nothing about the noise.
    void wake(double y) {
        banks_.reset(new Banks(rules_.ahead));
        memory_.past.clear();
        memory_.steps.clear();
        for (int i = 0; i < memory_.kept; ++i) memory_.recent[i] = __builtin_nanf("");
        if (!fixed_) origin_ = y;
        apart_ = y - origin_;
        has_last_ = false;
        gate_ = RestGate();
        steps_ = StepTest();
        keep_twice();
    }

    // Even if hardly any sample changes, there is the noise of rounding to the smallest change.
    void note_change(double y) {
        const double change = std::fabs(y - last_);
        if (change > 0 && has_last_ && (rounding_ == 0 || change < rounding_ * kRoundings)) {
            rounding_ = change / kRoundings;
        }
        last_ = y;
        has_last_ = true;
    }

    void go_on(bool take) {
        if (model_ == nullptr) {
            banks_->bank.go_on(take);
        } else {
            model_->go_on(take);
        }
    }

    void predict_over(std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            begin_sample(0);
            go_on(false);
        }
        keep_twice();
    }

    Known known() const { return model_ == nullptr ? banks_->bank.known() : model_->known(e_); }

    Tracked tracked(bool moving) const {
        if (model_ == nullptr && !banks_->bank.knows()) {
            const double none = __builtin_nan("");
            return Tracked{none, none, none, none, none, moving};
        }
        Known now = known();
        if (!moving && !fixed_) suspect(now);
        const bool absolute = model_ == nullptr || model_->model().absolute();
        return Tracked{now.state + (absolute && !fixed_ ? origin_ : 0),
                       std::sqrt(now.state_variance),
                       now.bias + origin_,
                       std::sqrt(now.bias_variance),
                       e_,
                       moving};
    }

    // If a step may have happened, the bias is the mean of both cases, weighted by their probability.
    void suspect(Known& now) const {
        const StepSuspected& one = steps_.suspected();
        if (!(one.likely > 0)) return;
        const double size = one.size * deviation_;
        now.bias += one.likely * size;
        now.bias_variance +=
            one.likely * (1 - one.likely) * size * size + one.likely * one.variance * deviation_ * deviation_;
    }

    // A step smaller than the noise of one sample cannot be distinguished from noise quickly.
    double largest_step() const {
        return std::fmax(rules_.largest_step, deviation_ < kLargest ? kLeastOfNoise * deviation_ : 0);
    }

    // Bias relative to the origin.
    double bias() const {
        if (model_ != nullptr) return model_->bias();
        return banks_->bank.knows() ? banks_->bank.known().bias : 0;
    }
    // Apparent size of the detected step. It is computed from the samples, because the step test limits large
    // innovations.
    double step_size() const {
        double sum = 0;
        int known = 0;
        for (const double y : memory_.newest(seen_.ago)) {
            if (std::isnan(y)) continue;
            sum += y;
            ++known;
        }
        return known > 0 ? sum / known - bias() : seen_.size * deviation_;
    }
    double bias_variance() const { return known().bias_variance; }
    // Bias before the steps that may be the beginning of motion.
    double settled_bias() const { return before_ != nullptr ? before_->bias : bias(); }

    void note_before() {
        if (before_ == nullptr) {
            before_.reset(new Before{model_->state(), bias(), memory_.total, memory_.total, 0});
        }
        before_->newest = memory_.total;
        ++before_->steps;
    }

    // Filters all remembered samples once more.
    void again() {
        steps_.clear();
        gate_.forget_chunk();
        check_.skip();
        model_->filter_again(memory_);
        keep_twice();
    }

    // Whether small steps in the same direction follow each other. They are a drift, not steps.
    bool goes_on(const StepSeen& seen, double size) const {
        const std::int64_t since = memory_.total - last_step_.at;
        return seen.ago >= kSlow && size * last_step_.size > 0 && since < kSoon * std::int64_t(seen.ago);
    }

    // The bias keeps growing, so it drifts by more than its model says. Until the next model, a larger random
    // walk of the offset accounts for the drift.
    void drift(const StepSeen& seen, double change) {
        steps_.clear();
        if (model_ == nullptr) return;
        const double size = seen.kind == StepSeen::kDrift ? seen.size * deviation_ : change;
        if (!model_->raise_walk(size * size / double(seen.ago), rules_)) return;
        before_.reset();
        check_.set(model_->model());
        again();
    }

    // Without a model, estimates the noise again from the samples since the step.
    bool begin_bank_at(int ago, double size, double was, double was_variance, BiasStep& found) {
        steps_.clear();
        if (banks_->bank.count() < kFewestOfBank || ago < WalkBank::kFewest) return false;
        const std::vector<double> since = memory_.newest(ago);
        banks_.reset(new Banks(rules_.ahead));
        for (const double y : since) {
            banks_->bank.predict(std::isnan(y) ? 0 : y);
            banks_->bank.go_on(!std::isnan(y));
        }
        memory_.steps.add(memory_.total - ago, kWide * size * size);
        if (!banks_->bank.knows()) return false;
        gate_.forget_chunk();
        keep_twice();
        // The bank has already followed the step for a while, so the mean of earlier samples gives the bias
        // before it.
        double before = was, variance = was_variance;
        mean_before(ago, before, variance);
        return told(BiasStep{ago, bias() - before, std::sqrt(bias_variance() + variance)}, found);
    }

    bool told(const BiasStep& step, BiasStep& found) {
        ++counts_.steps;
        found = step;
        return true;
    }

    // Mean of up to kBefore samples before the newest `ago`, and its variance. Changes nothing if there are
    // too few samples.
    void mean_before(int ago, double& mean, double& variance) const {
        const std::vector<double> all = memory_.newest(ago + kBefore);
        double sum = 0, squares = 0;
        int known = 0;
        for (std::size_t i = 0; i + std::size_t(ago) < all.size(); ++i) {
            if (std::isnan(all[i])) continue;
            sum += all[i];
            squares += all[i] * all[i];
            ++known;
        }
        if (known < WalkBank::kFewest) return;
        mean = sum / known;
        variance = std::fmax(squares / known - mean * mean, 0) / known;
    }

    // Keeps a copy of the filter. After the next chunk it serves as the state one chunk ago.
    void keep() {
        if (model_ != nullptr) {
            model_->keep();
        } else {
            std::swap(banks_->before[0], banks_->before[1]);
            banks_->before[1] = banks_->bank;
        }
    }
    void keep_twice() {
        keep();
        keep();
    }

    template <typename Io>
    void visit_before(Io& io) {
        if (before_ == nullptr) before_.reset(new Before{model_->state(), 0, 0, 0, 0});
        Before& one = *before_;
        io.real(one.bias, -1e200, 1e200);
        io.number(one.at, 0, double(memory_.total));
        io.number(one.newest, double(one.at), double(memory_.total));
        io.number(one.steps, 0, double(counts_.steps));
        model_->visit_state(io, one.state);
    }

    TrackerRules rules_;
    bool fixed_, has_origin_ = false, has_last_ = false;
    double origin_ = 0, last_ = 0, rounding_ = 0;
    // Of the newest sample: its value relative to the origin, its innovation, and the deviation of the
    // innovation.
    double apart_ = 0, e_ = 0, deviation_ = kLargest, for_steps_ = 0;
    StepSeen seen_ = StepSeen{StepSeen::kNothing, 0, 0};
    LastStep last_step_ = LastStep{0, 0};
    TrackerCounts counts_ = TrackerCounts();
    RestGate gate_;
    StepTest steps_;
    BiasCheck check_;
    Remembered memory_;
    Whiteness white_;
    std::unique_ptr<NoiseModel> model_;
    std::unique_ptr<Before> before_;
    std::unique_ptr<Banks> banks_;  // until there is a model
};

}  // namespace track
}  // namespace fltea
