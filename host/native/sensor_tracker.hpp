// Tracks the biases of all axes of one sensor. Motion concerns the whole sensor. If one axis or the
// accelerometer shows motion, the trackers of all axes only predict.
#pragma once

#include <vector>

#include "axis_tracker.hpp"
#include "gravity_gate.hpp"

namespace fltea {
namespace track {

// An event at a sample: a step of the bias, or the beginning or end of a motion.
struct TrackerEvent {
    enum Kind { kStep, kMoves, kRests };
    Kind kind;
    std::size_t row;
    // The axis whose bias has stepped or which has shown the motion. If the accelerometer has shown the
    // motion, the value is kByAccel. If the caller has announced it, the value is kByCaller.
    int axis;
    // number of samples since the step or since the beginning of the motion, including the newest sample
    std::int64_t ago;
    // size of the step, and its standard deviation; at the end of a motion, `size` is the largest distance of
    // a sample from the bias
    double size, size_std;
    std::int64_t samples;  // at the end of a motion: how long it lasted [samples]
    enum { kByAccel = -1, kByCaller = -2 };
};

// What the caller knows about motion of the sensor during the samples of one call.
enum Rest { kUnknown = 0, kAtRest = 1, kMoving = 2 };

class SensorTracker {
  public:
    SensorTracker(const TrackerRules& rules, double largest_gravity_step)
        : rules_(rules), largest_gravity_step_(largest_gravity_step) {}

    void add_axis(const double* offset) { axes_.emplace_back(rules_, offset); }
    std::vector<AxisTracker>& axes() { return axes_; }
    const std::vector<AxisTracker>& axes() const { return axes_; }
    bool moving() const { return moving_; }

    // Processes a sample. `y`: the sample's value on each axis. `accel`: the values of `accel_axes` axes of
    // the accelerometer, or null. The results of all axes are written to `to`.
    void next(const double* y, const double* accel, int accel_axes, Rest rest, std::size_t row, Tracked* to,
              std::vector<TrackerEvent>& events) {
        const std::size_t n = axes_.size();
        int spiked = kNone;
        for (std::size_t i = 0; i < n; ++i) {
            if (axes_[i].predict(y[i])) spiked = int(i);
        }
        if (accel != nullptr) gravity_.add(accel, accel_axes);
        if (spiked != kNone) spiked_ = true;
        if (rest == kMoving && !moving_) {
            for (AxisTracker& one : axes_) one.pause();
            begin_motion(TrackerEvent::kByCaller, 1, row, events);
        }
        if (rest == kMoving) said_ = true;
        const bool moves = moving_ || spiked_;
        for (std::size_t i = 0; i < n; ++i) to[i] = axes_[i].take(moves);
        if (moving_) note_motion();
        if (!moves) look_for_steps(row, events);
        if (++fill_ == RestGate::kChunk) end_chunk(rest, row, events);
    }

    // Call this if `count` samples of all axes are missing.
    void skip(std::uint64_t count) {
        if (count > AxisTracker::kLongestGap) {
            begin_again();
            return;
        }
        if (axes_.empty() || !axes_.front().has_begun()) return;
        for (std::uint64_t k = 0; k < count; ++k) {
            for (AxisTracker& one : axes_) one.miss();
            if (moving_) ++moved_;
            if (++fill_ == RestGate::kChunk) drop_chunk();
        }
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(fill_, 0, RestGate::kChunk - 1);
        io.number(quiet_, 0, kQuiet);
        io.number(stood_, 0, 1e15);
        io.number(moving_, 0, 1);
        io.number(spiked_, 0, 1);
        io.number(said_, 0, 1);
        io.number(moved_, 0, 1e15);
        io.real(largest_, 0, 1e200);
        io.number(by_, kNone, 1e6);
        gravity_.visit(io);
        for (AxisTracker& one : axes_) {
            one.visit(io);
            io.require(one.memory().kept % RestGate::kChunk == fill_ || one.memory().kept == 0);
        }
    }

  private:
    enum { kQuiet = 2, kNone = -3 };

    void look_for_steps(std::size_t row, std::vector<TrackerEvent>& events) {
        for (std::size_t i = 0; i < axes_.size(); ++i) {
            if (axes_[i].seen() == StepSeen::kStep && axes_[i].is_too_far()) {
                go_back(int(i), row, events);
                return;
            }
        }
        for (std::size_t i = 0; i < axes_.size(); ++i) {
            BiasStep step = {};
            if (axes_[i].seen() == StepSeen::kNothing || !axes_[i].step(step)) continue;
            events.push_back(
                TrackerEvent{TrackerEvent::kStep, row, int(i), step.ago, step.size, step.size_std, 0});
        }
    }

    // Handles a motion that began some samples ago. Undoes what these samples have changed in the trackers of
    // all axes.
    void go_back(int by, std::size_t row, std::vector<TrackerEvent>& events) {
        std::int64_t undone = 0;
        for (AxisTracker& one : axes_) {
            const std::int64_t before = one.go_back();
            undone = before > undone ? before : undone;
        }
        begin_motion(by, undone, row, events);
    }

    void begin_motion(int by, std::int64_t ago, std::size_t row, std::vector<TrackerEvent>& events) {
        moving_ = true;
        quiet_ = 0;
        stood_ = 0;
        moved_ = ago;
        largest_ = 0;
        by_ = by;
        note_largest();
        events.push_back(TrackerEvent{TrackerEvent::kMoves, row, by, ago, 0, 0, 0});
    }

    void end_motion(std::size_t row, std::vector<TrackerEvent>& events) {
        moving_ = false;
        stood_ = 0;
        events.push_back(TrackerEvent{TrackerEvent::kRests, row, by_, 0, largest_, 0, moved_});
    }

    void note_motion() {
        ++moved_;
        note_largest();
    }
    void note_largest() {
        for (const AxisTracker& one : axes_) largest_ = std::fmax(largest_, one.off());
    }

    void end_chunk(Rest rest, std::size_t row, std::vector<TrackerEvent>& events) {
        int by = kNone;
        bool same = true, nearer = true;
        for (std::size_t i = 0; i < axes_.size(); ++i) {
            const ChunkVerdict one = axes_[i].end_chunk(moving_);
            if (one.knock && by == kNone) by = int(i);
            same = same && one.same_place;
            // Most biases are small. If the mean of a chunk is farther from 0 than the present bias, a
            // rotation of the sensor is therefore likelier than a new bias.
            const double place = one.place + axes_[i].origin();
            nearer = nearer && std::fabs(place) <= std::fabs(axes_[i].absolute_bias());
        }
        if (gravity_.end_chunk(largest_gravity_step_, moving_)) {
            if (by == kNone) by = TrackerEvent::kByAccel;
            same = false;
        }
        if (said_ && by == kNone) by = TrackerEvent::kByCaller;
        fill_ = 0;
        spiked_ = said_ = false;
        if (!moving_) {
            if (by != kNone) go_back(by, row, events);
        } else {
            quiet_ = by == kNone ? quiet_ + 1 : 0;
            stood_ = same ? stood_ + RestGate::kChunk : 0;
            const bool settles = rules_.settles || rest == kAtRest || nearer;
            if (quiet_ >= kQuiet) {
                end_motion(row, events);
            } else if (stood_ >= rules_.patience || (settles && stood_ >= rules_.still)) {
                end_motion(row, events);
                begin_again();
                for (AxisTracker& one : axes_) one.count_beginning();
                return;
            }
        }
        for (AxisTracker& one : axes_) one.roll();
    }

    // Ends a chunk in which samples are missing, without judging it.
    void drop_chunk() {
        for (AxisTracker& one : axes_) {
            one.drop_chunk();
            one.roll();
        }
        gravity_.drop_chunk();
        fill_ = 0;
        spiked_ = said_ = false;
    }

    void begin_again() {
        for (AxisTracker& one : axes_) one.begin_again();
        gravity_.forget();
        moving_ = spiked_ = said_ = false;
        fill_ = 0;
        quiet_ = 0;
        stood_ = 0;
    }

    TrackerRules rules_;
    double largest_gravity_step_;
    std::vector<AxisTracker> axes_;
    GravityGate gravity_;
    int fill_ = 0, quiet_ = 0, by_ = kNone;
    bool moving_ = false, spiked_ = false, said_ = false;
    std::int64_t stood_ = 0, moved_ = 0;
    double largest_ = 0;
};

}  // namespace track
}  // namespace fltea
