// Checks whether the published standard deviation of the bias is right. The mean of the samples of the next T
// seconds differs from the published bias for three reasons: the error of that bias, the movement of the true
// bias meanwhile, and white noise. The check compares the actual difference with its expected standard
// deviation, so it does not need the true bias.
#pragma once

#include <cmath>
#include <cstdint>

#include "noise_model.hpp"

namespace fltea {
namespace track {

class BiasCheck {
  public:
    enum { kTimes = BiasLengths::kChecks };
    struct Found {
        std::uint64_t pieces;
        // Each check divides the difference between the mean of some samples and the bias by the expected
        // standard deviation of this difference. `rms`: root mean square of these ratios; about 1 if the
        // standard deviations are right, NaN before the first check is complete
        double rms;
    };

    // Sets `length`, the number of samples whose mean is compared with the bias in check number `which`. If
    // `length` is 0, this check is not made.
    void expect(int which, std::int64_t length) { pieces_[which].length = length; }

    // Call this when another noise model applies from the next sample on.
    void set(const TrackerModel& model) {
        density_ = model.density();
        for (int k = 0; k < kTimes; ++k) {
            pieces_[k].length = model.lengths().checked[k];
            for (std::size_t i = 0; i < model.count(); ++i) pieces_[k].ahead[i] = model.rival(i).checked[k];
        }
        skip();
    }

    // Call this for a sample that is missing or shows motion. The sums of samples that are in progress are
    // dropped, because a check needs consecutive samples at rest.
    void skip() {
        for (Piece& one : pieces_) one.ends = 0;
        count_ = 0;
        due_ = 1;
        sum_ = 0;
    }

    // Adds a sample that was measured at rest. The filters must have processed it already.
    void add(const NoiseModel& model, double y) {
        sum_ += y;
        if (++count_ >= due_) end_pieces(model);
    }

    Found found(int which) const {
        const Piece& one = pieces_[which];
        return Found{one.pieces,
                     one.pieces > 0 ? std::sqrt(one.squares / double(one.pieces)) : __builtin_nan("")};
    }

    template <typename Io>
    void visit(Io& io) {
        io.real(density_, 0, 1e300);
        io.real(sum_, -1e200, 1e200);
        io.number(count_, 0, 1e15);
        io.number(due_, 0, 1e15);
        for (Piece& one : pieces_) {
            io.number(one.length, 0, 1e15);
            io.number(one.ends, 0, 1e15);
            io.number(one.pieces, 0, 1e15);
            for (MeanAhead<kMost>& of_system : one.ahead) {
                for (double& x : of_system.row) io.real(x, -1e150, 1e150);
                io.real(of_system.variance, 0, 1e300);
            }
            for (double* x : {&one.bias, &one.sum_before}) io.real(*x, -1e200, 1e200);
            io.real(one.squares, 0, 1e300);
            io.real(one.variance, 1e-300, 1e300);
        }
    }

  private:
    struct Piece {
        // `length`: number of consecutive samples whose mean is compared with the bias. `ends`: number of the
        // sample at which the comparison in progress ends, or 0 if there is none
        std::int64_t length = 0, ends = 0;
        double bias = 0, variance = 1, sum_before = 0, squares = 0;
        std::uint64_t pieces = 0;
        // for each candidate system of the noise model: forecast of the mean of the bias over the next
        // `length` samples
        MeanAhead<kMost> ahead[TrackerModel::kRivals] = {};
    };

    void end_pieces(const NoiseModel& model) {
        due_ = INT64_MAX;
        for (Piece& one : pieces_) {
            if (one.length == 0) continue;
            if (one.ends > 0 && count_ < one.ends) {
                due_ = one.ends < due_ ? one.ends : due_;
                continue;
            }
            if (one.ends > 0) {
                const double off = (sum_ - one.sum_before) / double(one.length) - one.bias;
                one.squares += off * off / one.variance;
                ++one.pieces;
            }
            one.ends = count_ + one.length;
            one.sum_before = sum_;
            model.mean_of(one.ahead, one.bias, one.variance);
            one.variance = std::fmax(one.variance + density_ / double(one.length), 1e-300);
            due_ = one.ends < due_ ? one.ends : due_;
        }
        if (due_ == INT64_MAX) due_ = count_ + kNever;
    }

    enum : std::int64_t { kNever = 1000000000 };

    double density_ = 0, sum_ = 0;
    std::int64_t count_ = 0, due_ = 1;
    Piece pieces_[kTimes];
};

}  // namespace track
}  // namespace fltea
