// The number types with which the host computes its running spectrum in floating point. The algorithm is the
// template in firmware/core/engine/octave_ladder.hpp.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include "fading_sums.hpp"
#include "gate.hpp"
#include "octave_ladder.hpp"
#include "time_cells.hpp"
#include "time_scales.hpp"

namespace fltea {

template <typename Number>
class RealTables {
  public:
    enum { kBlock = 256, kHalf = kBlock / 2 };

    RealTables() {
        const double turn = 2 * 3.14159265358979323846 / kBlock;
        for (int i = 0; i < kHalf; ++i) {
            even_[i] = Number(0.5 - 0.5 * std::cos(turn * (2 * i)));
            odd_[i] = Number(0.5 - 0.5 * std::cos(turn * (2 * i + 1)));
            cosine_[i] = Number(std::cos(turn * i));
            sine_[i] = Number(std::sin(turn * i));
        }
    }
    // Hann's window at the even and at the odd indexes of a block; cosine and sine of the angle 2π i/256.
    Number even(int i) const { return even_[i]; }
    Number odd(int i) const { return odd_[i]; }
    Number cosine(int i) const { return cosine_[i]; }
    Number sine(int i) const { return sine_[i]; }

  private:
    Number even_[kHalf], odd_[kHalf], cosine_[kHalf], sine_[kHalf];
};

// The number types of a running spectrum that is computed with the type Number, which is float or double.
// kMostLevels: largest number of levels. 20 levels cover half a year of samples at 100 Hz.
template <typename Number, int kMostLevels = 20, int kMostKept = 3072>
struct RealSpectrum {
    typedef double Input;  // samples, which have to be finite and within ±1e100
    typedef double Real;
    typedef Number Value;
    typedef Number Sum;
    typedef Number Coefficient;
    typedef Number Power;
    typedef float Stored;
    typedef float Kept;
    typedef RealTables<Number> Tables;
    typedef FadingMemory Memory;
    template <int kLines>
    using Sums = FadingSums<kLines>;
    enum { kLevels = kMostLevels, kCapacity = kMostKept, kMostMadeUp = 64 };
    static constexpr double kLargest = 1e19;  // largest magnitude of what value() returns

    static double input(double y) { return y; }
    static double root(double x) { return std::sqrt(x); }
    static constexpr Number coefficient(double c) { return Number(c); }
    static Number product(Number x, Number c) { return x * c; }
    static Number products(Number x, Number c, Number y, Number d) { return x * c + y * d; }
    static Number filtered(Number sum, int) { return sum; }
    static const Tables& tables() {
        static const Tables one;
        return one;
    }

    // Three figures of n samples: their mean, the sum of their squared distances from the mean, and the
    // largest of these squared distances.
    class Moments {
      public:
        Moments(const double* x, int n) {
            double sums[4] = {0, 0, 0, 0}, powers[4] = {0, 0, 0, 0};
            const double origin = x[0];
            for (int i = 0; i < n; ++i) sums[i % 4] += x[i] - origin;
            mean_ = origin + ((sums[0] + sums[1]) + (sums[2] + sums[3])) / n;
            largest_ = 0;
            for (int i = 0; i < n; ++i) {
                const double apart = x[i] - mean_, power = apart * apart;
                powers[i % 4] += power;
                if (power > largest_) largest_ = power;
            }
            power_ = (powers[0] + powers[1]) + (powers[2] + powers[3]);
        }
        double mean() const { return mean_; }
        double power() const { return power_; }
        double largest() const { return largest_; }

      private:
        double mean_, power_, largest_;
    };
    // Smallest nonzero difference between consecutive samples; 0 if there is none.
    static double least_change(const double* x, int n) {
        double least = std::numeric_limits<double>::infinity();
        for (int i = 1; i < n; ++i) {
            const double change = std::fabs(x[i] - x[i - 1]);
            const double one = change > 0 ? change : least;
            if (one < least) least = one;
        }
        return std::isinf(least) ? 0 : least;
    }

    // Returns a sample minus the origin, a value that is subtracted from all samples up to the next break.
    // Values beyond those of any sensor are clipped, so that they do not become infinite in a float.
    static Number value(double y, double origin) {
        const double apart = y - origin, most = kLargest;
        return Number(apart > most ? most : apart < -most ? -most : apart);
    }

    struct Base {
        void store(const Number* in, int n, float* x, int fill) {
            for (int i = 0; i < n; ++i) x[fill + i] = float(in[i]);
        }
        void lift(Number*, int, int) const {}
        int shift() const { return 0; }
        void renew(float*, int) {}
    };

    // A block of values minus the mean of the block.
    template <typename Stored>
    class Centred {
      public:
        Centred(const Stored* x, int n) : x_(x) {
            Number sums[4] = {0, 0, 0, 0};
            for (int i = 0; i < n; i += 4) {
                for (int k = 0; k < 4; ++k) sums[k] += Number(x[i + k]);
            }
            mean_ = ((sums[0] + sums[1]) + (sums[2] + sums[3])) / Number(n);
        }
        Number operator[](int i) const { return Number(x_[i]) - mean_; }
        int places() const { return 0; }

      private:
        const Stored* x_;
        Number mean_;
    };

    // Records how the power in one level of the running spectrum changes over time. Each block of 256 samples
    // of the level gives one value, the logarithm of its mean power. Level 0 has the shortest blocks, so its
    // changes are recorded at all time scales. A higher level has lower frequencies, whose power may change
    // at other times. Its changes are recorded only at short time scales, from a block to the next few.
    template <int kLines>
    class Cells : public TimeCells {
      public:
        typedef TimeScales<(kLines > 64 ? 16 : 4)> Scales;

        Cells(FadingMemory memory, std::uint64_t hop)
            : TimeCells(span(memory, hop, kMost - 1)), scales_(span(memory, hop, 2)) {}

        const Scales& scales() const { return scales_; }
        void merge(const Cells& other, std::uint64_t shift) {
            TimeCells::merge(other, shift);
            scales_.merge(other.scales_);
        }
        template <typename Io>
        void visit(Io& io) {
            TimeCells::visit(io);
            if (io.sound()) scales_.visit(io);
        }

        template <typename Power>
        void note(std::uint64_t first, const Power* power, int lines, double scale) {
            double sum = 0;
            for (int i = 0; i < lines; ++i) sum += double(power[i]);
            if (!(sum > 0)) return;
            const float figure = float(std::log(sum / (lines * scale)));
            add(first, figure);
            scales_.add(figure);
        }

      private:
        // Divides a time of two memory lengths into `parts` parts, and returns the number of blocks in each
        // part. Returns 0 if nothing is forgotten.
        static std::uint32_t span(FadingMemory memory, std::uint64_t hop, int parts) {
            if (!memory.fades()) return 0;
            const double span = std::ceil(2 * memory.samples() / (double(hop) * parts));
            return span < 1e9 ? std::uint32_t(span < 1 ? 1 : span) : 1000000000u;
        }

        Scales scales_;
    };
};

template <typename Number, int kMostLevels, int kMostKept>
constexpr double RealSpectrum<Number, kMostLevels, kMostKept>::kLargest;

// Returns the gain of the half-band filter at a frequency, which is given as an angle per sample. The gain is
// computed from the taps in double, whatever type the filter itself uses.
inline double half_band_gain(double angle) {
    typedef engine::HalfBand<RealSpectrum<double>> Filter;
    double sum = Filter::middle();
    for (int k = 0; k < Filter::kTaps; ++k) {
        sum += 2 * Filter::tap(k) * std::cos((Filter::kDelay - 2 * k) * angle);
    }
    return sum;
}

}  // namespace fltea
