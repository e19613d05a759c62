// Determines the noise of rounding from the smallest difference between consecutive samples. The sensor's
// noise is at least that large, even if hardly any sample differs from the previous one.
#pragma once

#include <cmath>

namespace fltea {
namespace track {

class Rounding {
  public:
    // Adds a sample.
    void add(double y) {
        const double change = std::fabs(y - last_);
        if (change > 0 && has_last_ && (deviation_ == 0 || change < deviation_ * kRoundings)) {
            deviation_ = change / kRoundings;
        }
        last_ = y;
        has_last_ = true;
    }
    // Whether the sample `y` differs from the one before it.
    bool changes(double y) const { return y != last_ && has_last_; }
    // Call this if the next sample cannot be compared with the last one.
    void forget_last() { has_last_ = false; }

    // Standard deviation of the noise of rounding, or 0 until two consecutive samples have differed.
    double deviation() const { return deviation_; }

    // `largest`: the magnitude of a sample never reaches this.
    template <typename Io>
    void visit(Io& io, double largest) {
        io.number(has_last_, 0, 1);
        io.real(last_, -2 * largest, 2 * largest);
        io.real(deviation_, 0, 2 * largest);
    }

  private:
    // √12: rounding to multiples of 1 has the standard deviation 1/√12
    static constexpr double kRoundings = 3.4641016151377544;

    bool has_last_ = false;
    double last_ = 0, deviation_ = 0;
};

}  // namespace track
}  // namespace fltea
