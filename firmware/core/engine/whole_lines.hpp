// Computes the periodogram of a stretch (samples without a break) on the device, one ordinate at a time and
// in integers.
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

    // Copies the n samples x of a stretch and subtracts their mean. `slow`: whether a fitted cubic polynomial
    // is subtracted, too. Without this, a drift whose end differs from its beginning would leak into all
    // frequencies.
    void take(const std::int32_t* x, int n, bool slow) {
        n_ = n;
        std::int64_t sum = 0;
        for (int i = 0; i < n; ++i) sum += x[i];
        const std::int32_t mean = static_cast<std::int32_t>(sum / n);
        std::int32_t largest = 1;
        for (int i = 0; i < n; ++i) {
            y_[i] = x[i] - mean;
            if (y_[i] > largest) largest = y_[i];
            if (-y_[i] > largest) largest = -y_[i];
        }
        lift_ = __builtin_clz(static_cast<unsigned>(largest)) - (32 - kBits);
        for (int i = 0; i < n; ++i) y_[i] = lift_ >= 0 ? y_[i] * (1 << lift_) : y_[i] >> -lift_;
        if (slow) take_cubic_off();
        // Each pair of samples at the same distance from the middle is replaced by their sum and their
        // difference.
        for (int i = 0; i < n / 2; ++i) {
            const std::int32_t early = y_[i], late = y_[n - 1 - i];
            y_[i] = late + early;
            y_[n - 1 - i] = late - early;
        }
    }

    // Returns ordinate j of the periodogram: |sum of x e^{-iλt}|² / n at λ = 2π j / n, in the squared unit of
    // x, for 0 < 2j < n.
    float power(int j) const {
        // `angle` is λ / π, in units of 2^-28. Cosines and sines are in units of 2^-30.
        const std::int32_t angle =
            static_cast<std::int32_t>((static_cast<std::int64_t>(2 * j) * (1 << 28) + n_ / 2) / n_);
        const std::int32_t c = cosine(angle), s = fixed::sin_pi(angle);
        const bool odd = n_ % 2 != 0;
        std::int32_t re = odd ? c : cosine(angle / 2), im = odd ? s : fixed::sin_pi(angle / 2);
        std::int64_t sum_re = odd ? static_cast<std::int64_t>(y_[n_ / 2]) * (1 << 30) : 0, sum_im = 0;
        for (int i = n_ / 2 - 1; i >= 0; --i) {
            sum_re += static_cast<std::int64_t>(y_[i]) * re;
            sum_im += static_cast<std::int64_t>(y_[n_ - 1 - i]) * im;
            const std::int32_t next = turned(re, c, im, -s);
            im = turned(im, c, re, s);
            re = next;
        }
        const float a = fixed::to_float(sum_re, -30 - lift_), b = fixed::to_float(sum_im, -30 - lift_);
        return (a * a + b * b) / static_cast<float>(n_);
    }

  private:
    enum { kBits = 22 };

    static std::int32_t cosine(std::int32_t angle) { return fixed::sin_pi(angle + (1 << 27)); }
    static std::int32_t turned(std::int32_t x, std::int32_t c, std::int32_t y, std::int32_t s) {
        const std::int64_t sum = static_cast<std::int64_t>(x) * c + static_cast<std::int64_t>(y) * s;
        return static_cast<std::int32_t>((sum + (1 << 29)) >> 30);
    }
    static std::int64_t fine(float x) {
        const float most = 1.0e9f, cut = x > most ? most : x < -most ? -most : x;
        const std::int32_t whole = static_cast<std::int32_t>(cut);
        const float rest = cut - static_cast<float>(whole);
        return static_cast<std::int64_t>(whole) * (INT64_C(1) << kFine) +
               static_cast<std::int32_t>(rest * static_cast<float>(1 << kFine));
    }
    // The cubic is computed from sample to sample by adding differences. The differences are in units of
    // 2^-30, so that their rounding errors add up to only 0.01 over 512 samples.
    enum { kFine = 30 };

    // Subtracts from y_ the cubic in t = 2i - (n - 1) that fits best, using orthogonal polynomials.
    void take_cubic_off() {
        std::int64_t by_t = 0, by_square = 0, by_cube = 0, sum = 0;
        for (int i = 0; i < n_; ++i) {
            const std::int32_t t = 2 * i - (n_ - 1);
            const std::int64_t along = static_cast<std::int64_t>(y_[i]) * t;
            sum += y_[i];
            by_t += along;
            by_square += along * t;
            by_cube += along * (static_cast<std::int64_t>(t) * t);
        }
        // Over the samples, the polynomials 1, t, t² - level and t³ - bend t are orthogonal. The mean squares
        // of the last three are `level`, `square` and `cube`.
        const float n = static_cast<float>(n_), nn = n * n, level = (nn - 1) / 3;
        const float bend = (3 * nn - 7) / 5;
        const float square = 4.0f * (nn - 1) * (nn - 4) / 45;
        const float cube = 4.0f * (nn - 1) * (nn - 4) * (nn - 9) / 175;
        const float mean = fixed::to_float(sum, 0) / n;
        const float a = fixed::to_float(by_t, 0) / (n * level);
        const float b = (fixed::to_float(by_square, 0) / n - level * mean) / square;
        const float c = (fixed::to_float(by_cube, 0) - bend * fixed::to_float(by_t, 0)) / (n * cube);
        // `value` is the cubic at the first sample. Its value at the next sample follows by adding its first
        // difference. The second difference is then added to the first, and the third to the second.
        const float t = 1 - n, linear = a - c * bend;
        std::int64_t value = fine(mean - b * level + t * (linear + t * (b + t * c)));
        std::int64_t first = fine(2 * linear + b * (4 * t + 4) + c * (6 * t * t + 12 * t + 8));
        std::int64_t second = fine(8 * b + c * (24 * t + 48));
        const std::int64_t third = fine(48 * c);
        for (int i = 0; i < n_; ++i) {
            y_[i] -= static_cast<std::int32_t>((value + (INT64_C(1) << (kFine - 1))) >> kFine);
            value += first;
            first += second;
            second += third;
        }
    }

    std::int32_t y_[kMost];
    int n_, lift_;  // the unit of y_ is 2^-lift_ times the unit of the samples
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
