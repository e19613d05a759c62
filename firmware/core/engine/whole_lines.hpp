// Ordinates of a stretch that is kept whole, one at a time, in integers: the device's.
#ifndef FLTEA_WHOLE_LINES_HPP
#define FLTEA_WHOLE_LINES_HPP

#include <cstdint>

#include "fixed_math.hpp"
#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

template <int kMost>
class WholeLines {
  public:
    WholeLines() : n_(0), lift_(0) {}

    int size() const { return n_; }

    // Takes a stretch, less its mean, or, if `slow`, less a cubic: drift that ends elsewhere than it began
    // leaks into all frequencies.
    void take(const std::int32_t* x, int n, bool slow) {
        n_ = n;
        std::int64_t sum = 0;
        for (int i = 0; i < n; ++i) sum += x[i];
        const std::int32_t mean = static_cast<std::int32_t>(sum / n);
        float at[4] = {0, 0, 0, 0};
        if (slow) cubic(x, mean, at);
        std::int32_t largest = 1;
        for (int i = 0; i < n; ++i) {
            std::int32_t y = x[i] - mean;
            if (slow) {
                const float t = place(i);
                y -= static_cast<std::int32_t>(at[0] + t * (at[1] + t * (at[2] + t * at[3])));
            }
            y_[i] = y;
            if (y > largest) largest = y;
            if (-y > largest) largest = -y;
        }
        lift_ = __builtin_clz(static_cast<unsigned>(largest)) - (32 - 22);
        for (int i = 0; i < n; ++i) y_[i] = lift_ >= 0 ? y_[i] * (1 << lift_) : y_[i] >> -lift_;
    }

    // |sum of x e^{-iλt}|² / n of the ordinate λ = 2π j / n, in the squared unit of x; 0 < 2j < n.
    float power(int j) const {
        // The turn from sample to sample, in 2^-30 and as an angle over π in 2^-28.
        const std::int32_t angle =
            static_cast<std::int32_t>((static_cast<std::int64_t>(2 * j) * (1 << 28) + n_ / 2) / n_);
        const std::int32_t c = fixed::sin_pi(angle + (1 << 27)), s = fixed::sin_pi(angle);
        std::int32_t re = 1 << 30, im = 0;
        std::int64_t sum_re = 0, sum_im = 0;
        for (int i = 0; i < n_; ++i) {
            sum_re += static_cast<std::int64_t>(y_[i]) * re;
            sum_im += static_cast<std::int64_t>(y_[i]) * im;
            const std::int32_t next = turned(re, c, im, -s);
            im = turned(im, c, re, s);
            re = next;
        }
        const float a = fixed::to_float(sum_re, -30 - lift_), b = fixed::to_float(sum_im, -30 - lift_);
        return (a * a + b * b) / static_cast<float>(n_);
    }

  private:
    static std::int32_t turned(std::int32_t x, std::int32_t c, std::int32_t y, std::int32_t s) {
        const std::int64_t sum = static_cast<std::int64_t>(x) * c + static_cast<std::int64_t>(y) * s;
        return static_cast<std::int32_t>((sum + (1 << 29)) >> 30);
    }

    // From -1 to 1.
    float place(int i) const { return static_cast<float>(2 * i - (n_ - 1)) / static_cast<float>(n_ - 1); }

    // Coefficients of the best cubic of x less its mean, by polynomials that are orthogonal over the places.
    void cubic(const std::int32_t* x, std::int32_t mean, float (&at)[4]) const {
        float squares = 0, fourths = 0;
        for (int i = 0; i < n_; ++i) {
            const float t = place(i);
            squares += t * t;
            fourths += t * t * t * t;
        }
        const float n = static_cast<float>(n_), level = squares / n, bend = fourths / squares;
        float by[3] = {0, 0, 0}, power[3] = {0, 0, 0};
        for (int i = 0; i < n_; ++i) {
            const float t = place(i), y = static_cast<float>(x[i] - mean);
            const float basis[3] = {t, t * t - level, t * (t * t - bend)};
            for (int k = 0; k < 3; ++k) {
                by[k] += basis[k] * y;
                power[k] += basis[k] * basis[k];
            }
        }
        const float a = by[0] / power[0], b = by[1] / power[1], c = by[2] / power[2];
        at[0] = -b * level;
        at[1] = a - c * bend;
        at[2] = b;
        at[3] = c;
    }

    std::int32_t y_[kMost];
    int n_, lift_;  // y_ is in 2^-lift of the unit of x
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
