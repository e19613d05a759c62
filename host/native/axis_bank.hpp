// Computes the estimates of all axes of one sensor. It has the start-up window, the filters of the algorithm
// FLTEA with the supervisors that restart them, and the test whether the innovations are white. One call
// processes any number of rows. A row has one value for each axis.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "baseline.hpp"
#include "lanes.hpp"
#include "whiteness.hpp"

namespace fltea {

// Output arrays for a block of estimates, each of shape (rows, axes).
struct BankBlock {
    double* columns[kLaneColumns];  // NaN where an axis is not valid
    std::uint8_t* valid;            // 1 where an axis is valid, else 0
    // 1 where the innovations of an axis are white (Whiteness::is_white), else 0
    std::uint8_t* white;
};

// Result of a fit for one axis: the order and the parameter f, each with its standard deviation.
//
// A filter treats the variances Q and R, and its linear approximation of the model, as exact, although they
// are not. The standard deviation that it reports therefore becomes smaller and smaller, even if its estimate
// is wrong. For this reason, the published standard deviation is never smaller than that of the fit, and it
// grows with the distance of the filter's estimate from the fitted value.
struct Known {
    bool any;  // whether there is a fit for this axis
    double alpha, alpha_std, f, f_std;
};

class AxisBank {
  public:
    // `axes`: number of axes, at least one.
    explicit AxisBank(std::size_t axes)
        : axes_(axes),
          window_(axes),
          white_(axes),
          bias_(axes, 0),
          live_(axes, 0),
          known_(axes, Known()),
          newest_(axes, Order{__builtin_nan(""), __builtin_nan("")}) {}

    std::size_t axes() const { return axes_; }
    bool started() const { return lanes_ != nullptr; }

    // Returns mean and variance of an axis over its start-up window, which consists of all rows before
    // start().
    const engine::Baseline<double>& window(std::size_t axis) const { return window_[axis]; }

    // Ends the start-up window. From the next row on, `bias` is subtracted from the samples, and each axis is
    // filtered by one of the `lanes`. An axis for which `live` is 0 stays invalid, whatever its lane reports.
    void start(std::unique_ptr<LaneRunner> lanes, const double* bias, const std::uint8_t* live) {
        lanes_ = std::move(lanes);
        bias_.assign(bias, bias + axes_);
        live_.assign(live, live + axes_);
    }

    // Sets the results of the newest fits. From the next row on, the published standard deviations are at
    // least those of these fits.
    void know(const std::vector<Known>& known) { known_ = known; }

    struct Order {
        double alpha, alpha_std;
    };
    // Returns the order that the filter has estimated after the last row, with the standard deviation that
    // the filter itself states, or NaN if the axis is not valid.
    const Order& newest(std::size_t axis) const { return newest_[axis]; }

    LaneRunner* lanes() { return lanes_.get(); }
    const Whiteness& whiteness(std::size_t axis) const { return white_[axis]; }
    std::vector<Whiteness>& whiteness() { return white_; }

    // Processes rows of `y` (rows, axes), all finite. Appends each axis that becomes invalid to `lost`,
    // together with the row at which that happens.
    void run(const double* y, std::size_t rows, const BankBlock& out, std::vector<Lost>& lost) {
        for (std::size_t first = 0; first < rows; first += kSlab) {
            const std::size_t n = std::min(std::size_t(kSlab), rows - first), place = first * axes_;
            if (started()) {
                for (std::size_t i = 0; i < n * axes_; ++i) {
                    const std::size_t axis = i % axes_;
                    centred_[i] = live_[axis] ? y[place + i] - bias_[axis] : 0;
                }
                run_lanes(nullptr, n, shifted(out, place), first, lost);
            } else {
                collect(y + place, n, shifted(out, place));
            }
        }
        if (rows == 0) return;
        for (std::size_t axis = 0; axis < axes_; ++axis) {
            const std::size_t last = (rows - 1) * axes_ + axis;
            newest_[axis] = Order{out.columns[kLaneAlpha][last], out.columns[kLaneAlphaStd][last]};
            const Known& known = known_[axis];
            if (!known.any) continue;
            widen(known.alpha, known.alpha_std, axis, rows, out.columns[kLaneAlpha],
                  out.columns[kLaneAlphaStd]);
            widen(known.f, known.f_std, axis, rows, out.columns[kLaneF], out.columns[kLaneFStd]);
        }
    }

    // Lets the filters predict `count` missing rows. Before start(), missing rows change nothing. Row numbers
    // in `lost` are counted from the first missing row.
    void skip(std::size_t count, std::vector<Lost>& lost) {
        if (count > 0) {
            for (Whiteness& one : white_) one.skip();
        }
        if (!started()) return;
        const std::vector<std::uint8_t> missing(kSlab * axes_, 1);
        std::vector<double> unread(kLaneColumns * kSlab * axes_);
        std::vector<std::uint8_t> valid(kSlab * axes_);
        BankBlock out = {{}, valid.data(), nullptr};
        for (std::size_t i = 0; i < kLaneColumns; ++i) out.columns[i] = unread.data() + i * kSlab * axes_;
        for (std::size_t first = 0; first < count; first += kSlab) {
            run_lanes(missing.data(), std::min(std::size_t(kSlab), count - first), out, first, lost);
        }
    }

  private:
    // Number of rows that are processed at a time. The number is small, so that what one step of the
    // processing writes is still in the cache for the next step.
    enum : std::size_t { kSlab = 128 };

    static BankBlock shifted(const BankBlock& out, std::size_t place) {
        BankBlock result = out;
        for (double*& column : result.columns) column += place;
        result.valid += place;
        result.white += place;
        return result;
    }

    void widen(double known, double known_std, std::size_t axis, std::size_t rows, const double* values,
               double* deviations) const {
        for (std::size_t i = axis; i < rows * axes_; i += axes_) {
            const double least = deviations[i] < known_std ? known_std : deviations[i];
            const double gone = values[i] - known;
            deviations[i] = std::sqrt(least * least + gone * gone);
        }
    }

    void collect(const double* y, std::size_t rows, const BankBlock& out) {
        for (std::size_t i = 0; i < rows * axes_; ++i) window_[i % axes_].add(y[i]);
        for (double* column : out.columns) std::fill(column, column + rows * axes_, __builtin_nan(""));
        std::fill(out.valid, out.valid + rows * axes_, std::uint8_t(0));
        std::fill(out.white, out.white + rows * axes_, std::uint8_t(0));
    }

    void run_lanes(const std::uint8_t* missing, std::size_t rows, const BankBlock& out, std::size_t first,
                   std::vector<Lost>& lost) {
        const std::size_t before = lost.size();
        lanes_->run(centred_.data(), missing, rows, out.columns, out.valid, lost, first);
        for (std::size_t axis = 0; axis < axes_; ++axis) {
            if (!live_[axis]) forget(axis, rows, out);
        }
        lost.erase(std::remove_if(lost.begin() + static_cast<std::ptrdiff_t>(before), lost.end(),
                                  [this](const Lost& one) { return !live_[one.lane]; }),
                   lost.end());
        if (missing != nullptr) return;
        const double *const innovation = out.columns[kLaneInnovation], *const std =
                                                                           out.columns[kLaneInnovationStd];
        for (std::size_t i = 0; i < rows * axes_; ++i) {
            Whiteness& white = white_[i % axes_];
            if (out.valid[i]) {
                white.add(innovation[i], std[i]);
            } else {
                white.skip();
            }
            out.white[i] = white.is_white();
        }
    }

    // Clears the outputs of axes that are not live, because the lanes of these axes have written to the
    // outputs, too.
    void forget(std::size_t axis, std::size_t rows, const BankBlock& out) {
        for (std::size_t i = axis; i < rows * axes_; i += axes_) {
            for (double* column : out.columns) column[i] = __builtin_nan("");
            out.valid[i] = 0;
        }
    }

    std::size_t axes_;
    std::vector<engine::Baseline<double>> window_;
    std::vector<Whiteness> white_;
    std::vector<double> bias_;
    std::vector<std::uint8_t> live_;
    std::vector<Known> known_;
    std::vector<Order> newest_;
    std::vector<double> centred_ = std::vector<double>(kSlab * axes_);
    std::unique_ptr<LaneRunner> lanes_;
};

}  // namespace fltea
