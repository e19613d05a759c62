// The board's running spectrum in integers, for a processor without floating point: from the counts of an
// axis it computes sums of powers for each frequency. The spectrum consists of levels: level 0 is the stream
// of samples, and each further level is the stream of the level before at half the rate (octave_ladder.hpp).
//
// The values of level 0 are in units of 1/1,024 count, so their rounding adds far less noise than the
// rounding of the counts themselves. Each level has less noise than the level before. Three of the first five
// steps from one level to the next therefore halve the unit.
//
// A level stores each value in 16 bits, as its difference from a base. The base is changed when the values
// drift away from it. If the values spread too far for 16 bits, the differences are stored in a larger unit.
// In a bin of white noise that is averaged over at least eight blocks, the power agrees to 0.1 % with a
// computation in double.
#ifndef FLTEA_COUNT_SPECTRUM_HPP
#define FLTEA_COUNT_SPECTRUM_HPP

#include <cstdint>

#include "count_sums.hpp"
#include "fixed_math.hpp"
#include "gate.hpp"
#include "octave_ladder.hpp"
#include "octave_tables.hpp"
#include "soft_sqrt.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The number types of the running spectrum in integers. 12 levels (kMostLevels) with a capacity of 496
// samples each cover nearly three hours at 100 Hz. If the record is longer, the last level drops its oldest
// samples, while the sums of the other levels still contain all samples.
template <int kMostLevels = 12, int kMostKept = 496>
struct CountSpectrum {
    typedef std::int16_t Input;
    typedef float Real;
    typedef std::int32_t Value;
    typedef std::int64_t Sum;
    typedef std::int32_t Coefficient;  // coefficient of a filter, in units of 2^-30
    typedef std::int64_t Power;
    typedef std::int16_t Stored;
    typedef std::int32_t Kept;
    typedef CosineTable<> Tables;
    template <int kLines>
    using Sums = CountSums<kLines>;
    enum { kLevels = kMostLevels, kCapacity = kMostKept, kMostMadeUp = 16, kOne = 30, kMostHalvings = 3 };

    // Rounds a value in counts to a whole count that fits into 16 bits.
    static Input input(float y) {
        const std::int32_t count = static_cast<std::int32_t>(y < 0 ? y - 0.5f : y + 0.5f);
        return static_cast<Input>(count > 32767 ? 32767 : count < -32768 ? -32768 : count);
    }
    static float root(float x) { return soft_sqrt(x); }
    static constexpr Coefficient coefficient(double c) {
        return static_cast<Coefficient>(c * 1073741824.0 + (c < 0 ? -0.5 : 0.5));
    }
    static Value product(Value x, Coefficient c) { return rounded(Sum(x) * c, kOne); }
    static Value products(Value x, Coefficient c, Value y, Coefficient d) {
        return rounded(Sum(x) * c + Sum(y) * d, kOne);
    }
    // Converts an output of the half-band filter to the unit of the next level. The filter has computed the
    // output from values of `level`.
    static Value filtered(Sum sum, int level) { return rounded(sum, kOne - finer(level)); }
    static Tables tables() { return Tables(); }

    // Returns 1 if the unit of level + 1 is half the unit of `level`, and 0 if both units are equal.
    static constexpr int finer(int level) { return level % 2 == 0 && level < 2 * kMostHalvings ? 1 : 0; }
    // Returns the number n: the unit of `level` is 2^-n times the unit of level 0.
    static constexpr int halvings(int level) {
        return (level + 1) / 2 < kMostHalvings ? (level + 1) / 2 : int(kMostHalvings);
    }

    // Three figures of n samples: their mean, the sum of their squared distances from the mean, and the
    // largest of these squared distances.
    class Moments {
      public:
        Moments(const Input* x, int n) {
            std::int32_t sum = 0, low = x[0], high = x[0];
            std::int64_t squares = 0;
            for (int i = 0; i < n; ++i) {
                const std::int32_t one = x[i];
                sum += one;
                squares += static_cast<std::int64_t>(one) * one;
                if (one < low) low = one;
                if (one > high) high = one;
            }
            // n times the sum of the squared distances of the samples from their mean, without rounding
            const std::int64_t power = squares * n - static_cast<std::int64_t>(sum) * sum;
            const float size = static_cast<float>(n);
            mean_ = static_cast<float>(sum) / size;
            power_ = fixed::to_float(power, 0) / size;
            // The distances of the largest and the smallest sample from the mean, multiplied by n, are
            // integers. So the only rounding is that of the division by n.
            const float up = static_cast<float>(high * n - sum) / size;
            const float down = static_cast<float>(sum - low * n) / size;
            largest_ = up > down ? up * up : down * down;
        }
        float mean() const { return mean_; }
        float power() const { return power_; }
        float largest() const { return largest_; }

      private:
        float mean_, power_, largest_;
    };
    // Smallest nonzero difference between consecutive samples; 0 if there is none.
    static float least_change(const Input* x, int n) {
        std::int32_t least = 0;
        for (int i = 1; i < n; ++i) {
            const std::int32_t apart = x[i] - x[i - 1], change = apart < 0 ? -apart : apart;
            if (change > 0 && (least == 0 || change < least)) least = change;
        }
        return static_cast<float>(least);
    }

    // Says how fast old samples are forgotten. Here they never are, so all samples count the same.
    struct Memory {
        static constexpr bool fades() { return false; }
        static constexpr int generation(std::uint64_t) { return 0; }
        static constexpr int part(std::uint64_t) { return 0; }
        static constexpr std::uint64_t oldest(std::uint64_t) { return 0; }
    };

    // The unit of level 0 is 2^-kPlaces counts. The units of the other levels are at most eight times
    // smaller. In all of them, the largest values of a sensor fit into a Value.
    enum { kPlaces = 10 };
    static Value value(Input y, Input origin) { return (Value(y) - Value(origin)) * (1 << kPlaces); }

    // Base and unit of the values that a level stores in 16 bits. The unit is 2^shift times the level's unit.
    // Base and unit are chosen anew from all stored values when a new value would not fit into 16 bits, and
    // when a smaller unit is possible again.
    class Base {
      public:
        Base() : base_(0), shift_(0) {}

        void store(const Value* in, int n, Stored* x, int fill) {
            for (int i = 0; i < n; ++i) {
                if (!fits(in[i] - base_)) choose(in[i], x, fill + i, kCoarsest);
                x[fill + i] = stored(in[i]);
            }
        }
        // Converts outputs of the half-band filter, which were computed from stored values of `level`, to the
        // unit of the next level.
        void lift(Value* out, int n, int level) const {
            const Value base = base_ * (1 << finer(level));
            for (int i = 0; i < n; ++i) out[i] = out[i] * (1 << shift_) + base;
        }
        int shift() const { return shift_; }
        // Call this when stored values were dropped: the rest may fit into 16 bits with a smaller unit.
        void renew(Stored* x, int fill) {
            if (shift_ > 0) choose(value(x[0]), x, fill, shift_ - 1);
        }

      private:
        enum { kReach = 32000, kChosen = 16000, kCoarsest = 31 };

        bool fits(Value apart) const { return within(apart, Value(kReach) << shift_); }
        static bool within(Value x, Value most) { return x <= most && x >= -most; }
        Stored stored(Value x) const {
            return static_cast<Stored>(shift_ > 0 ? rounded(x - base_, shift_) : x - base_);
        }
        Value value(Stored x) const { return Value(x) * (1 << shift_) + base_; }

        // Chooses base and unit anew: the base half way between the smallest and the largest value, and the
        // unit so large that all stored values and the newest one fit into 16 bits. `most`: if the new unit
        // were larger than 2^most times the level's own unit, nothing is changed.
        void choose(Value newest, Stored* x, int fill, int most) {
            Value low = newest, high = newest;
            for (int i = 0; i < fill; ++i) {
                const Value one = value(x[i]);
                if (one < low) low = one;
                if (one > high) high = one;
            }
            Base next;
            next.base_ = low + (high - low) / 2;
            while ((high - low) / 2 > Value(kChosen) << next.shift_) ++next.shift_;
            if (next.shift_ > most) return;
            for (int i = 0; i < fill; ++i) x[i] = next.stored(value(x[i]));
            *this = next;
        }

        Value base_;
        int shift_;
    };

    // A block of values minus the mean of the block, in units of 2^-places. The unit is chosen so that the
    // largest value has about 22 bits. The Fourier transform makes values up to 128 times as large, and its
    // results have to fit into 32 bits.
    template <typename From>
    class Centred {
      public:
        Centred(const From* x, int n) : x_(x), sum_(0), lift_(0) {
            for (int i = 0; i < n; ++i) sum_ += x[i];
            Value largest = 1;
            for (int i = 0; i < n; ++i) {
                const Value apart = fine(i);
                if (apart > largest) largest = apart;
                if (-apart > largest) largest = -apart;
            }
            lift_ = __builtin_clz(static_cast<unsigned>(largest)) - (32 - 22);
        }
        Value operator[](int i) const {
            return lift_ >= 0 ? fine(i) * (1 << lift_) : rounded(fine(i), -lift_);
        }
        int places() const { return kFine + lift_; }

      private:
        enum { kFine = 8 };  // the mean of 256 integers is a multiple of 2^-8, so it is exact in this unit

        Value fine(int i) const { return Value(x_[i]) * (1 << kFine) - sum_; }

        const From* x_;
        Value sum_;
        int lift_;
    };

    // Does nothing, because the board keeps no record of the spectrum over time.
    template <int kLines>
    struct Cells {
        Cells(Memory, std::uint64_t) {}
        void note(std::uint64_t, const Power*, int, double) {}
    };

  private:
    // Returns `sum` times 2^-places, rounded to the nearest integer. `places` is above 0.
    static Value rounded(Sum sum, int places) {
        return static_cast<Value>((sum + (Sum(1) << (places - 1))) >> places);
    }
};

// The running spectrum of one axis. Counts are added one by one.
template <typename Kind = CountSpectrum<>>
class CountOctaves {
  public:
    typedef OctaveLadder<Kind> Ladder;
    typedef typename Ladder::Passage Passage;

    void add(std::int16_t count) {
        Passage passage;
        add(count, passage);
        while (!pass(passage)) {
        }
    }
    // Begins to add a raw reading of an axis to its spectrum. After that, call pass() until it returns true,
    // before anything else is called. Each call of pass() handles one level (one sampling rate). `passage`
    // stores the values on their way from level to level. Several axes may use the same one, one after the
    // other.
    void add(std::int16_t count, Passage& passage) {
        Entrance entrance = {ladder_, passage};
        gate_.add(&count, 1, 1, entrance);
    }
    bool pass(Passage& passage) { return ladder_.advance(passage); }
    // Notes that `lost` samples are missing before the next sample.
    void skip(std::uint64_t lost) { gate_.skip(lost); }

    const GateCounts& counts() const { return gate_.counts(); }
    bool constant() const { return gate_.constant(); }
    // Number of the next sample. Up to 127 samples before that one are not yet in the spectrum, because their
    // chunk is not complete.
    std::uint64_t now() const { return gate_.number(); }
    const Ladder& ladder() const { return ladder_; }
    // Returns the exponent e: the powers of `level` are in units of 2^e squared counts.
    int exponent(int level) const { return -2 * (int(Kind::kPlaces) + Kind::halvings(level)); }

  private:
    // Receives the samples that the gate (gate.hpp) has accepted, and passes them on to the levels.
    struct Entrance {
        Ladder& ladder;
        Passage& passage;
        void accept(const std::int16_t* y, int n, std::uint64_t first, const unsigned char* made_up) {
            ladder.enter(y, n, first, made_up, passage);
        }
        void cut() { ladder.cut_after(passage); }
    };

    Gate<Kind> gate_;
    Ladder ladder_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
