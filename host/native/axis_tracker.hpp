// Tracks the present bias of one axis and its standard deviation while the sensor is at rest. The tracker
// uses the filter of the fitted noise model; until there is a model, it uses a bank of filters for typical
// noises (walk_bank.hpp). Rest and motion are decided for all axes together (sensor_tracker.hpp). The results
// do not depend on how samples are grouped into calls.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "axis_filter.hpp"
#include "bias_check.hpp"
#include "past.hpp"
#include "remembered.hpp"
#include "rest_gate.hpp"
#include "rounding.hpp"
#include "step_test.hpp"
#include "tracker_results.hpp"
#include "tracker_rules.hpp"
#include "undoable_steps.hpp"
#include "whiteness.hpp"

namespace fltea {
namespace track {

class AxisTracker {
  public:
    // The tracker restarts if more consecutive samples than this are missing.
    enum { kLongestGap = 100000 };
    // The magnitude of a sensor's value never reaches this.
    static constexpr double kLargest = 1e100;

    // `offset`: the known offset of the sensor, or null if it is to be tracked.
    AxisTracker(const TrackerRules& rules, const double* offset)
        : rules_(rules), fixed_(offset != nullptr), filter_(rules.ahead) {
        if (fixed_) origin_ = *offset;
        for (int i = 0; i < BiasCheck::kTimes; ++i) check_.expect(i, rules.checked[i]);
        begin_again();
    }

    // Whether any sample has arrived yet.
    bool has_begun() const { return has_origin_; }
    // State vector after the newest sample. It describes samples minus the origin, which is the known offset
    // or the first sample. If the noise model has two candidate systems, the state is that of the likelier
    // one. Without a model the vector is empty.
    const double* x() const { return filter_.x(); }
    int size() const { return filter_.size(); }
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
        if (!filter_.has_model() || filter_.size() != next->size()) white_.skip();
        steps_ = begun->steps();
        filter_.use(std::move(next));
        undoable_.forget();
        check_.set(*model);
        return true;
    }
    const StepTest& steps() const { return steps_; }

    // Returns 2 log L of the samples if the models of the bank of filters describe them, up to a constant.
    // Returns NaN if the bank is no longer in use.
    double likelihood() const {
        return !filter_.has_model() && filter_.knows() ? filter_.bank().likelihood() : __builtin_nan("");
    }

    // Predicts the sample `y` from the samples before it. Returns true if this sample alone shows motion.
    // Call take() afterwards.
    bool predict(double y) {
        if (!has_origin_) {
            if (!fixed_) origin_ = y;
            has_origin_ = true;
        }
        apart_ = y - origin_;
        if (rounding_.changes(apart_) && has_slept()) wake(y);
        rounding_.add(apart_);
        const double z = begin_sample(apart_);
        return gate_.add(z, apart_, deviation_);
    }

    Tracked take(bool moving) {
        filter_.go_on(!moving);
        seen_ = StepSeen{StepSeen::kNothing, 0, 0};
        if (moving) {
            ++counts_.moved;
            white_.skip();
            check_.skip();
        } else {
            if (filter_.has_model()) {
                white_.add(filter_.innovation(), std::sqrt(filter_.variance()));
                check_.add(filter_.model(), apart_);
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
        filter_.go_on(false);
        memory_.add(__builtin_nanf(""));
    }

    // The kind of change of the bias that the step test has detected at the newest sample.
    StepSeen::Kind seen() const { return seen_.kind; }
    // Whether the detected step would move the bias farther than largest_step() away from settled_bias(), the
    // bias before the newest steps.
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
        if (!filter_.has_model()) return begin_bank_at(seen.ago, size, was, was_variance, found);
        if (filter_.model().offset() < 0) {
            steps_.clear();
            return false;
        }
        undoable_.add(filter_.model(), memory_.total);
        filter_.model().forget_newest();
        memory_.steps.add(memory_.total - seen.ago, kWide * size * size);
        again();
        return told(BiasStep{seen.ago, bias() - was, std::sqrt(bias_variance() + was_variance)}, found);
    }

    // Decides at the end of a chunk of samples whether this chunk shows motion. Call this before roll().
    ChunkVerdict end_chunk(bool moving) {
        return gate_.end_chunk(deviation_, settled_bias(), largest_step(), moving);
    }

    void drop_chunk() { gate_.drop_chunk(); }

    // Call this when motion was detected. Restores the filter as it was before the previous chunk of samples,
    // or before the steps that were the beginning of the motion. Returns the number of samples undone.
    std::int64_t go_back() {
        steps_.clear();
        check_.skip();
        std::int64_t count = memory_.kept;
        if (undoable_.any()) {
            const UndoableSteps::Undone undone = undoable_.undo(filter_.model(), memory_.total);
            count = undone.samples;
            counts_.steps -= undone.steps;
            memory_.forget(int(count < int(Past::kSingle) ? count : int(Past::kSingle)));
        } else {
            memory_.forget(memory_.kept);
            filter_.go_back();
        }
        predict_over(count);
        return count;
    }

    // Call this before the first sample of a motion that the caller announces.
    void pause() {
        steps_.clear();
        check_.skip();
        undoable_.forget();
    }

    // Ends a chunk of samples.
    void roll() {
        undoable_.forget_settled(memory_.total);
        memory_.roll();
        filter_.keep();
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
        undoable_.forget();
        last_step_ = LastStep{0, 0};
        rounding_.forget_last();
        if (!fixed_) has_origin_ = false;
        filter_.start();
    }
    void count_beginning() { ++counts_.begun; }

    // Distance of the newest sample from settled_bias(), the bias before the newest steps.
    double off() const { return std::fabs(apart_ - settled_bias()); }
    // The present bias, which is the published figure.
    double absolute_bias() const { return bias() + origin_; }

    template <typename Io>
    void visit(Io& io) {
        bool has_model = filter_.has_model(), has_steps = undoable_.any();
        io.number(has_model, 0, 1);
        io.number(has_steps, 0, 1);
        io.number(has_origin_, 0, 1);
        io.real(origin_, -kLargest, kLargest);
        rounding_.visit(io, kLargest);
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
        io.require(has_model || !has_steps);
        filter_.visit(io, has_model);
        if (!has_model || !has_steps) undoable_.forget();
        if (has_model && has_steps && io.sound())
            undoable_.visit(io, filter_.model(), memory_.total, counts_.steps);
    }

  private:
    // kWide: At first, the size of a step is known only roughly. The variance of this size is then assumed to
    // be kWide times the square of the apparent size.
    static constexpr double kWide = 10, kLeastOfNoise = 2;
    enum { kFewestOfBank = 1024, kSlow = 1024, kSoon = 4, kBefore = 512 };

    struct LastStep {
        std::int64_t at;  // number of all samples up to the one at which the step was reported
        double size;
    };

    // Returns the innovation of the sample `y`, divided by its expected standard deviation.
    double begin_sample(double y) {
        filter_.predict(y);
        const double e = filter_.innovation(), rounding = rounding_.deviation();
        deviation_ = filter_.knows() ? std::sqrt(filter_.variance()) : kLargest;
        const double z = filter_.has_model() ? filter_.model().for_steps(e) : e / deviation_;
        for_steps_ = deviation_ < rounding ? z * deviation_ / rounding : z;
        if (deviation_ < rounding) deviation_ = rounding;
        return e / deviation_;
    }

    // Whether all samples so far are equal, so that the noise cannot be estimated.
    bool has_slept() const {
        return !filter_.has_model() && filter_.knows() && !(filter_.variance() > kNothing);
    }

    // Handles the first sample that differs from all earlier samples. The equal samples before it say nothing
    // about the noise, so they are forgotten.
    void wake(double y) {
        filter_.start_bank();
        memory_.forget_all();
        if (!fixed_) origin_ = y;
        apart_ = y - origin_;
        rounding_.forget_last();
        gate_ = RestGate();
        steps_ = StepTest();
    }

    void predict_over(std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            begin_sample(0);
            filter_.go_on(false);
        }
        filter_.keep_twice();
    }

    Tracked tracked(bool moving) const {
        if (!filter_.knows()) {
            const double none = __builtin_nan("");
            return Tracked{none, none, none, none, none, moving};
        }
        Known now = filter_.known();
        if (!moving && !fixed_) steps_.suspected().add_to(now.bias, now.bias_variance, deviation_);
        const bool absolute = !filter_.has_model() || filter_.model().model().absolute();
        return Tracked{now.state + (absolute && !fixed_ ? origin_ : 0),
                       std::sqrt(now.state_variance),
                       now.bias + origin_,
                       std::sqrt(now.bias_variance),
                       filter_.innovation(),
                       moving};
    }

    // The largest change that counts as a step of the bias; a larger change is motion. The limit is at least
    // twice the standard deviation of a sample, because smaller changes are detected late amid the noise.
    double largest_step() const {
        return std::fmax(rules_.largest_step, deviation_ < kLargest ? kLeastOfNoise * deviation_ : 0);
    }

    double bias() const { return filter_.bias(); }
    // Size of the detected step. It is computed from the samples, because the step test clips large
    // innovations.
    double step_size() const {
        const KnownSamples since = memory_.known_samples(seen_.ago);
        return since.count > 0 ? since.mean - bias() : seen_.size * deviation_;
    }
    double bias_variance() const { return filter_.known().bias_variance; }
    // The bias before the newest steps if these may be the beginning of motion; otherwise the present bias.
    double settled_bias() const { return undoable_.any() ? undoable_.bias() : bias(); }

    // Filters all remembered samples once more.
    void again() {
        steps_.clear();
        gate_.forget_chunk();
        check_.skip();
        filter_.model().filter_again(memory_);
        filter_.keep_twice();
    }

    // Whether this step and the one before it have the same direction and follow each other soon. Such steps
    // are a drift.
    bool goes_on(const StepSeen& seen, double size) const {
        const std::int64_t since = memory_.total - last_step_.at;
        return seen.ago >= kSlow && size * last_step_.size > 0 && since < kSoon * std::int64_t(seen.ago);
    }

    // Handles a bias that drifts faster than the noise model says. Until the next model is set, the offset in
    // the present model does a random walk with larger steps.
    void drift(const StepSeen& seen, double change) {
        steps_.clear();
        if (!filter_.has_model()) return;
        const double size = seen.kind == StepSeen::kDrift ? seen.size * deviation_ : change;
        if (!filter_.model().raise_walk(size * size / double(seen.ago), rules_)) return;
        undoable_.forget();
        check_.set(filter_.model().model());
        again();
    }

    // Handles a step while there is no noise model. The bank of filters starts again with the samples since
    // the step.
    bool begin_bank_at(int ago, double size, double was, double was_variance, BiasStep& found) {
        steps_.clear();
        if (filter_.bank().count() < kFewestOfBank || ago < WalkBank::kFewest) return false;
        filter_.start_bank_with(memory_.newest(ago));
        memory_.steps.add(memory_.total - ago, kWide * size * size);
        if (!filter_.knows()) return false;
        gate_.forget_chunk();
        filter_.keep_twice();
        // The old bank of filters had already followed the step for a while. The bias before the step is
        // therefore computed as the mean of the samples before the step.
        const KnownSamples earlier = memory_.known_samples(kBefore, ago);
        const bool enough = earlier.count >= WalkBank::kFewest;
        const double before = enough ? earlier.mean : was;
        const double variance = enough ? earlier.variance / earlier.count : was_variance;
        return told(BiasStep{ago, bias() - before, std::sqrt(bias_variance() + variance)}, found);
    }

    bool told(const BiasStep& step, BiasStep& found) {
        ++counts_.steps;
        found = step;
        return true;
    }

    TrackerRules rules_;
    bool fixed_, has_origin_ = false;
    double origin_ = 0;
    Rounding rounding_;
    // Of the newest sample: its value minus the origin; the standard deviation of its innovation; and the
    // innovation that the step test uses, divided by its own standard deviation.
    double apart_ = 0, deviation_ = kLargest, for_steps_ = 0;
    StepSeen seen_ = StepSeen{StepSeen::kNothing, 0, 0};
    LastStep last_step_ = LastStep{0, 0};
    TrackerCounts counts_ = TrackerCounts();
    RestGate gate_;
    StepTest steps_;
    BiasCheck check_;
    Remembered memory_;
    Whiteness white_;
    AxisFilter filter_;
    UndoableSteps undoable_;
};

}  // namespace track
}  // namespace fltea
