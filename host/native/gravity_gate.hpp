// Detects motion of a sensor by its accelerometer. The sensor moves if the measured gravity changes its
// direction or magnitude, or if the samples scatter more than usual. The accelerometer's samples are judged
// in the same chunks as those of the gyroscope's axes.
#pragma once

#include <cmath>

namespace fltea {
namespace track {

class GravityGate {
  public:
    enum { kAxes = 3 };
    static constexpr double kKnock = 16, kMean = 8;

    // Adds a sample of an accelerometer with `axes` axes, of which only the first kAxes are used.
    void add(const double* y, int axes) {
        for (int i = 0; i < axes && i < kAxes; ++i) {
            if (known_ == 0) first_[i] = y[i];
            const double apart = y[i] - first_[i];
            sums_[i] += apart;
            squares_[i] += apart * apart;
        }
        axes_ = axes < kAxes ? axes : int(kAxes);
        ++known_;
    }

    // Ends a chunk of samples. Returns true if the chunk shows motion. `largest_step`: how far the mean of a
    // chunk at rest may differ from the mean of earlier chunks because the bias has changed.
    bool end_chunk(double largest_step, bool moving) {
        bool knock = false;
        const int n = known_;
        if (n > 1) {
            for (int i = 0; i < axes_; ++i) knock = judge(i, n, largest_step, moving) || knock;
            has_place_ = true;
        }
        drop_chunk();
        return knock;
    }

    void drop_chunk() {
        known_ = 0;
        for (int i = 0; i < kAxes; ++i) sums_[i] = squares_[i] = 0;
    }

    void forget() { *this = GravityGate(); }

    template <typename Io>
    void visit(Io& io) {
        io.number(axes_, 0, kAxes);
        io.number(known_, 0, 1e6);
        io.number(has_place_, 0, 1);
        for (int i = 0; i < kAxes; ++i) {
            for (double* one : {&first_[i], &sums_[i], &place_[i]}) io.real(*one, -1e200, 1e200);
            for (double* one : {&squares_[i], &usual_[i]}) io.real(*one, 0, 1e300);
        }
    }

  private:
    static constexpr double kLearned = 1 / 16.0, kOutlier = 4, kStill = 10;

    bool judge(int i, int n, double largest_step, bool moving) {
        const double mean = sums_[i] / n, place = first_[i] + mean;
        const double power = std::fmax(squares_[i] - mean * sums_[i], 0) / (n - 1);
        bool knock = false;
        if (has_place_) {
            // While the sensor moves, the limit for a change of the mean is lower, so that rest begins only
            // when the mean hardly changes any more.
            const double step = moving ? largest_step / kStill : largest_step;
            const double least = step + kMean * std::sqrt(usual_[i] * 2 / n);
            knock = power > kKnock * std::fmax(usual_[i], largest_step * largest_step / kKnock) ||
                    std::fabs(place - place_[i]) > least;
        }
        if (!has_place_ || (usual_[i] == 0 && !knock)) {
            usual_[i] = power;
        } else if (!knock && !moving) {
            usual_[i] += kLearned * (std::fmin(power, kOutlier * usual_[i]) - usual_[i]);
        }
        // place_ is the mean with which the mean of the next chunk is compared. During motion, place_ is the
        // mean of the latest chunk. At rest, place_ slowly follows the bias.
        place_[i] = !has_place_ || knock || moving ? place : place_[i] + kLearned * (place - place_[i]);
        return knock;
    }

    int axes_ = 0, known_ = 0;
    bool has_place_ = false;
    double first_[kAxes] = {}, sums_[kAxes] = {}, squares_[kAxes] = {}, place_[kAxes] = {},
           usual_[kAxes] = {};
};

}  // namespace track
}  // namespace fltea
