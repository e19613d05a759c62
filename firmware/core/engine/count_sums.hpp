// Sums of the powers of Welch blocks in one octave, in integers. The sums cannot overflow. When one of them
// comes near its limit, the unit of all sums is made twice as large.
#ifndef FLTEA_COUNT_SUMS_HPP
#define FLTEA_COUNT_SUMS_HPP

#include <cstdint>

#include "fixed_math.hpp"
#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Each sum has only 32 bits, because the board has three axes with many octaves. After a year, the unit is so
// large that a block of the highest octave adds only a few units. Fractions of a unit are rounded up or down
// at random, so that the sums are right on average.
template <int kLines>
class CountSums {
  public:
    // Adds the powers of a block of values. Each power is below 2^58. The unit of the powers is 2^-(2 places)
    // times the square of the unit in which this level of the running spectrum stores its values.
    void add(const std::int64_t* power, int places, int) {
        std::uint64_t largest = 0;
        for (int i = 0; i < kLines; ++i) {
            const std::uint64_t one = static_cast<std::uint64_t>(power[i]);
            if (one > largest) largest = one;
        }
        if (blocks_ == 0) {
            const int bits = largest > 0 ? 64 - __builtin_clzll(largest) : 0;
            coarse_ = (bits > kFirst ? bits - kFirst : 0) - 2 * places;
        }
        for (;;) {
            const int drop = coarse_ + 2 * places;
            if (drop >= 0 && most_ + rounded(largest, drop) + 1 < UINT64_C(1) << 32) break;
            coarsen(drop < 0 ? -drop : 1);
        }
        const int drop = coarse_ + 2 * places;
        most_ = 0;
        for (int i = 0; i < kLines; ++i) {
            power_[i] += static_cast<std::uint32_t>(dithered(static_cast<std::uint64_t>(power[i]), drop));
            if (power_[i] > most_) most_ = power_[i];
        }
        ++blocks_;
    }

    // Writes the sums, in the squared unit of the level's values. All blocks have the same weight.
    void read(int, float* power, float* blocks, float* effective) const {
        for (int i = 0; i < kLines; ++i) {
            power[i] = fixed::to_float(static_cast<std::int64_t>(power_[i]), coarse_);
        }
        *blocks = *effective = static_cast<float>(blocks_);
    }

  private:
    // the unit of the sums is first chosen so that the largest power of the first block has this number of
    // bits
    enum { kFirst = 30 };

    // The sums are in units of 2^coarse_ times the square of the unit of the level's values. Makes their unit
    // 2^places times as large, and rounds the sums to it.
    void coarsen(int places) {
        coarse_ += places;
        most_ = 0;
        for (int i = 0; i < kLines; ++i) {
            power_[i] = static_cast<std::uint32_t>(dithered(power_[i], places));
            if (power_[i] > most_) most_ = power_[i];
        }
    }

    static std::uint64_t rounded(std::uint64_t x, int places) {
        return places > 63 ? 0 : (x >> places) + (places > 0 ? 1 : 0);
    }

    // Returns x 2^-places, rounded up or down at random. The probability of rounding up is equal to the
    // fractional part, of which 24 bits are used.
    std::uint64_t dithered(std::uint64_t x, int places) {
        if (places == 0) return x;
        if (places > 63) return 0;
        chance_ = chance_ * 1664525u + 1013904223u;
        const std::uint32_t below = chance_ >> 8;
        const std::uint64_t rest = x & ((UINT64_C(1) << places) - 1);
        const std::uint32_t part =
            static_cast<std::uint32_t>(places > 24 ? rest >> (places - 24) : rest << (24 - places));
        return (x >> places) + (part > below ? 1 : 0);
    }

    std::uint32_t power_[kLines] = {};
    std::uint32_t most_ = 0;  // largest of the sums in power_
    std::uint32_t blocks_ = 0;
    std::uint32_t chance_ = 1;
    std::int32_t coarse_ = 0;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
