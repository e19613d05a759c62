// Decides whether the sensor moves, from the chunks of innovations of all its axes (axis_motion.hpp). If one
// axis moves, all axes count as moving. During motion, the trackers of all axes only predict and learn
// nothing. When motion is detected in a chunk, the trackers forget what they learned from that chunk and from
// the previous one.
//
// The motion ends after two chunks in which no axis moves. The bias is then that from before the motion. The
// motion also ends if the samples stay near a new mean for some seconds, because the bias itself may have
// stepped there. The new mean is then the bias. If it is farther away than a bias can step, the sensor
// probably rotates, and the new mean becomes the bias only after a much longer time.
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
        float far;  // largest change of the mean that may be a step of the bias [counts]
        // number of chunks after which a new mean is accepted as the bias: `still` if the change of the mean
        // is smaller than `far`, otherwise `still_far`
        std::uint16_t still, still_far;
    };

    bool moving() const { return moving_; }
    // Returns for how many samples the trackers have learned nothing because of motion. The uncertainty of
    // the trackers' results depends on this number.
    const Unlearned& unlearned() const { return unlearned_; }

    // Notes that `lost` samples of all axes are missing.
    void skip(std::uint32_t lost) { pass(lost); }

    // Call this once for each sample, after all n axes have received it.
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
    // kForgotten: number of samples at rest after which earlier motion no longer affects any filter
    enum { kQuiet = 2, kForgotten = 1 << 14 };

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
        // If there was an earlier motion, and the rest after it was shorter than that motion, then both
        // motions and the rest count as one long motion.
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
    // `since_newer_`: number of samples since the last call of keep(). `since_older_`: the same for the call
    // before that.
    std::uint32_t since_older_ = 0, since_newer_ = 0;
    int fill_ = 0, quiet_ = 0;
    bool moving_ = false;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
