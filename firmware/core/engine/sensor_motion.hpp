// Whether the sensor moves, by all of its axes: motion of one of them is motion of all. Then all predict, and
// learn nothing: what the chunk in which motion was found and the one before have done to any axis is undone.
//
// Rest is back after two chunks that are none of any axis, and the bias is what it was before. Samples that
// lie still elsewhere for some seconds are where the bias is now, if it can have stepped so far. Farther away
// it is a turn, until the rate is back, or has lain still for much longer.
#ifndef FLTEA_SENSOR_MOTION_HPP
#define FLTEA_SENSOR_MOTION_HPP

#include <cstdint>

#include "tracked_state.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

class SensorMotion {
  public:
    struct Limits {
        float far;                       // a bias steps by less, in counts
        std::uint16_t still, still_far;  // chunks until what lies nearer, or farther, is the bias
    };

    bool moving() const { return moving_; }
    // What the figures of the axes have to know of motion.
    const Unlearned& unlearned() const { return unlearned_; }

    // So many samples are lost.
    void skip(std::uint32_t lost) { pass(lost); }

    // After a sample of all n axes, of which each has had it.
    void next(TrackedState* const axes[], int n, const Limits& limits) {
        pass(1);
        if (++fill_ < AxisMotion::kChunk) return;
        fill_ = 0;
        unsigned knocks = 0;
        bool elsewhere = true;
        for (int i = 0; i < n; ++i) {
            const AxisMotion::Verdict found = axes[i]->judge(unlearned_, moving_);
            if (!found.knock) continue;
            knocks |= 1u << i;
            const bool far = found.mean >= limits.far || found.mean <= -limits.far;
            elsewhere = elsewhere && found.stood >= (far ? limits.still_far : limits.still);
        }
        quiet_ = knocks != 0 ? 0 : quiet_ + 1;
        if (!moving_) {
            if (knocks != 0) {
                stop_learning(axes, n);
            } else {
                keep(axes, n);
            }
        } else if (quiet_ >= kQuiet || (knocks != 0 && elsewhere)) {
            for (int i = 0; i < n; ++i) {
                if ((knocks >> i & 1) != 0) axes[i]->settle();
            }
            moving_ = false;
            keep(axes, n);
            keep(axes, n);
        }
    }

  private:
    enum { kQuiet = 2, kForgotten = 1 << 14 };  // after so many samples no filter knows of motion

    void pass(std::uint32_t samples) {
        since_older_ += samples;
        since_newer_ += samples;
        if (moving_) {
            unlearned_.samples += samples;
        } else if (unlearned_.samples != 0) {
            unlearned_.ago += samples;
            if (unlearned_.ago > kForgotten) unlearned_ = Unlearned();
        }
    }

    void stop_learning(TrackedState* const axes[], int n) {
        // Rest that was shorter than the motion before it counts as motion.
        if (unlearned_.ago >= unlearned_.samples + since_older_) unlearned_ = Unlearned();
        unlearned_.samples += unlearned_.ago > since_older_ ? unlearned_.ago : since_older_;
        unlearned_.ago = 0;
        for (int i = 0; i < n; ++i) axes[i]->undo(since_older_);
        moving_ = true;
    }

    void keep(TrackedState* const axes[], int n) {
        for (int i = 0; i < n; ++i) axes[i]->keep();
        since_older_ = since_newer_;
        since_newer_ = 0;
    }

    Unlearned unlearned_ = {0, 0};
    std::uint32_t since_older_ = 0, since_newer_ = 0;  // samples since what is kept
    int fill_ = 0, quiet_ = 0;
    bool moving_ = false;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
