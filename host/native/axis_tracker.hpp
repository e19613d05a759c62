// Tracks the present bias of one axis and its standard deviation while the sensor is at rest. The tracker
// uses the filter of the fitted noise model; until there is a model, it uses a bank of filters for typical
// noises (walk_bank.hpp). Rest and motion are decided for all axes together (sensor_tracker.hpp). The results
// do not depend on how samples are grouped into calls.
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

// Estimate after a sample, in the unit of the sample. Figures that are not known yet are NaN.
struct Tracked {
    double state, state_std, bias, bias_std, innovation;
    bool moving;
};

struct TrackerCounts {
    std::uint64_t moved;  // number of samples in motion
    std::uint64_t begun;  // number of times that the tracker restarted because the offset had changed
    std::uint64_t steps;  // number of steps of the bias
};

struct TrackerRules : BiasLengths {
    // A change of the samples' mean counts as a step of the bias if it is at most this large. A larger change
    // counts as motion.
    double largest_step = std::numeric_limits<double>::infinity();
    // When the samples stay at another mean, the tracker accepts that mean as the new offset after this
    // number of samples without motion. `still` applies if the new mean is nearer to 0, if the caller reports
    // rest, or if `settles` is set. Otherwise the sensor may be rotating, and `patience` applies.
    std::int64_t still = 1024, patience = 60000;
    // Whether the tracker accepts a mean farther from 0 as the new offset as quickly as a mean nearer to 0,
    // although the former may come from a rotation.
    bool settles = true;
};

// A step of the bias. The newest `ago` samples came after the step.
struct BiasStep {
    std::int64_t ago;
    double size, size_std;
};

class AxisTracker {
  public:
    // The tracker restarts if more consecutive samples than this are missing.
    enum { kLongestGap = 100000 };
    // The magnitude of a sensor's value never reaches this.
    static constexpr double kLargest = 1e100;

    // `offset`: the known offset of the sensor, or null if it is to be tracked.
    AxisTracker(const TrackerRules& rules, const double* offset) : rules_(rules), fixed_(offset != nullptr) {
        if (fixed_) origin_ = *offset;
        for (int i = 0; i < BiasCheck::kTimes; ++i) check_.expect(i, rules.checked[i]);
        begin_again();
    }

    // Whether any sample has arrived yet.
    bool has_begun() const { return has_origin_; }
    // State vector after the newest sample, relative to the origin. If the noise model has two candidate
    // systems, the state is that of the likelier system. Without a model the vector is empty.
    const double* x() const { return model_->x(); }
    int size() const { return model_ == nullptr ? 0 : model_->size(); }
    double origin() const { return origin_; }
    const TrackerCounts& counts() const { return counts_; }
    const Whiteness& whiteness() const { return white_; }
    const BiasCheck& check() const { return check_; }
    const Remembered& memory() const { return memory_; }
    bool fixed() const { return fixed_; }

    // Sets the noise model that is used from the next sample on. All remembered samples are filtered with it,
    // too. Returns false and changes nothing if no filter can work with the model. `begun`: a filter that has
    // already processed the remembered samples in another thread, or null. If `begun` is null or was made for
    // other remembered samples, the remembered samples are filtered in this call.
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

    // Returns 2 log L of the samples if the models of the bank of filters describe them, up to a constant.
    // Returns NaN if the bank is no longer in use.
    double likelihood() const {
        return banks_ != nullptr && banks_->bank.knows() ? banks_->bank.likelihood() : __builtin_nan("");
    }

    // Predicts the sample `y` from the samples before it. Returns true if this sample alone shows motion.
    // Call take() afterwards.
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

    // Advances by one sample that is missing. The filters only predict this sample.
    void miss() {
        white_.skip();
        check_.skip();
        begin_sample(0);
        go_on(false);
        memory_.add(__builtin_nanf(""));
    }

    // The kind of change of the bias that the step test has detected at the newest sample.
    StepSeen::Kind seen() const { return seen_.kind; }
    // Whether the detected step is too large for the bias, because it would move the bias by more than
    // largest_step() away from the settled value (settled_bias()).
    bool is_too_far() const { return !(std::fabs(bias() + step_size() - settled_bias()) <= largest_step()); }

    // Accepts the detected step: from now on, the bias is computed from the samples after the step. Returns
    // false if the change turns out not to be a step, but for example a drift.
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

    // Decides at the end of a chunk of samples whether this chunk shows motion. Call this before roll().
    ChunkVerdict end_chunk(bool moving) {
        return gate_.end_chunk(deviation_, settled_bias(), largest_step(), moving);
    }

    void drop_chunk() { gate_.drop_chunk(); }

    // Call this when motion was detected. Undoes what this chunk of samples, the chunk before it, and steps
    // just before the motion have changed in the filter. Returns the number of samples that were undone.
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

    // Call this before the first sample of a motion that the caller announces.
    void pause() {
        steps_.clear();
        check_.skip();
        before_.reset();
    }

    // Ends a chunk of samples.
    void roll() {
        if (before_ != nullptr && memory_.total - before_->newest > kSettled) before_.reset();
        memory_.roll();
        keep();
    }

    // Restarts the tracker. The tracker forgets the offset, but keeps the noise model and the usual size of
    // innovations.
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

    // Distance of the newest sample from the settled bias (settled_bias()).
    double off() const { return std::fabs(apart_ - settled_bias()); }
    // The present bias, which is the published figure.
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
    // √12: rounding to multiples of 1 has the standard deviation 1/√12
    static constexpr double kRoundings = 3.4641016151377544;
    // kWide: Before the size of a step is estimated, its variance is assumed to be this many times the square
    // of its apparent size. kSettled: If no further step follows within this number of samples, a step was
    // not the beginning of motion.
    static constexpr double kWide = 10, kLeastOfNoise = 2;
    enum { kSettled = 512, kFewestOfBank = 1024, kSlow = 1024, kSoon = 4, kBefore = 512 };

    struct Banks {
        explicit Banks(std::int64_t ahead) : bank(ahead), before{bank, bank} {}
        WalkBank bank, before[2];
    };

    struct LastStep {
        std::int64_t at;  // number of all samples up to the one at which the step was reported
        double size;
    };

    // State of the filter as it was before a series of steps that may be the beginning of motion.
    struct Before {
        NoiseModel::State state;
        double bias;
        std::int64_t at, newest;  // number of all samples when this state was saved, and at the newest step
        std::uint64_t steps;
    };

    // Returns the innovation of the sample `y`, divided by its expected standard deviation.
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

    // Whether all samples so far are equal, so that the noise cannot be estimated.
    bool has_slept() const {
        return model_ == nullptr && banks_->bank.knows() && !(banks_->bank.variance() > kNothing);
    }

    // Handles the first sample that differs from all earlier samples. The equal samples before it say nothing
    // about the noise, so they are forgotten.
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

    // Determines the noise of rounding from the smallest difference between consecutive samples. The sensor's
    // noise is at least that large, even if hardly any sample differs from the previous one.
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

    // If a step may have happened, the published bias is a mean of two values: the bias if there was a step,
    // and the bias if there was none. The probability of the step weights them.
    void suspect(Known& now) const {
        const StepSuspected& one = steps_.suspected();
        if (!(one.likely > 0)) return;
        const double size = one.size * deviation_;
        now.bias += one.likely * size;
        now.bias_variance +=
            one.likely * (1 - one.likely) * size * size + one.likely * one.variance * deviation_ * deviation_;
    }

    // The largest change that counts as a step of the bias. It is at least twice the standard deviation of a
    // sample's noise, because a smaller step cannot be distinguished from noise quickly.
    double largest_step() const {
        return std::fmax(rules_.largest_step, deviation_ < kLargest ? kLeastOfNoise * deviation_ : 0);
    }

    // The present bias, relative to the origin of the samples.
    double bias() const {
        if (model_ != nullptr) return model_->bias();
        return banks_->bank.knows() ? banks_->bank.known().bias : 0;
    }
    // Size of the detected step. It is computed from the samples, because the step test clips large
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
    // Bias before those steps that may be the beginning of motion; without such steps, the present bias.
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

    // Whether this step and the one before it have the same direction and follow each other soon. Such steps
    // are a drift.
    bool goes_on(const StepSeen& seen, double size) const {
        const std::int64_t since = memory_.total - last_step_.at;
        return seen.ago >= kSlow && size * last_step_.size > 0 && since < kSoon * std::int64_t(seen.ago);
    }

    // Handles a bias that drifts by more than the noise model says. Until the next model is set, the steps of
    // the offset's random walk have a larger variance to account for the drift.
    void drift(const StepSeen& seen, double change) {
        steps_.clear();
        if (model_ == nullptr) return;
        const double size = seen.kind == StepSeen::kDrift ? seen.size * deviation_ : change;
        if (!model_->raise_walk(size * size / double(seen.ago), rules_)) return;
        before_.reset();
        check_.set(model_->model());
        again();
    }

    // Handles a step while there is no noise model. The bank of filters starts again with the samples since
    // the step.
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
        // The old bank of filters had already followed the step for a while. The bias before the step is
        // therefore computed as the mean of the samples before the step.
        double before = was, variance = was_variance;
        mean_before(ago, before, variance);
        return told(BiasStep{ago, bias() - before, std::sqrt(bias_variance() + variance)}, found);
    }

    bool told(const BiasStep& step, BiasStep& found) {
        ++counts_.steps;
        found = step;
        return true;
    }

    // Computes the mean of up to kBefore samples that came before the newest `ago` samples, and the variance
    // of that mean. Leaves `mean` and `variance` unchanged if there are too few such samples.
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

    // Stores a copy of the filter at the end of a chunk. When the next chunk has ended, this copy is the
    // filter as it was one chunk earlier.
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
    // Three figures of the newest sample: its value relative to the origin, its innovation, and the standard
    // deviation of the innovation.
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
    std::unique_ptr<Banks> banks_;  // the bank of filters; null as soon as there is a noise model
};

}  // namespace track
}  // namespace fltea
