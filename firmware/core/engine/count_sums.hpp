// Welch's sums of one octave in integers. They cannot overflow: when one comes near its end, all of them are
// counted in a unit that is 256 times as large from there on.
#ifndef FLTEA_COUNT_SUMS_HPP
#define FLTEA_COUNT_SUMS_HPP

#include <cstdint>

#include "fixed_math.hpp"
#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

template <int kLines>
class CountSums {
  public:
    // Powers of a block that are less than 2^58 and in 2^-2 places of the squared unit.
    void add(const std::int64_t* power, int places, int) {
        const int least = kFine - 2 * places;
        if (coarse_ < least) coarsen(least - coarse_);
        const int drop = coarse_ - least;
        bool full = false;
        for (int i = 0; i < kLines; ++i) {
            power_[i] += rounded(static_cast<std::uint64_t>(power[i]), drop);
            full = full || power_[i] >= UINT64_C(1) << 62;
        }
        ++blocks_;
        if (full) coarsen(kStep);
    }

    // In the squared unit. All blocks have the same weight.
    void read(int, float* power, float* blocks, float* effective) const {
        for (int i = 0; i < kLines; ++i) {
            power[i] = fixed::to_float(static_cast<std::int64_t>(power_[i]), coarse_ - kFine);
        }
        *blocks = *effective = static_cast<float>(blocks_);
    }

  private:
    enum { kFine = 8, kStep = 8 };  // sums are in 2^(coarse - kFine)

    void coarsen(int places) {
        coarse_ += places;
        for (int i = 0; i < kLines; ++i) power_[i] = rounded(power_[i], places);
    }

    static std::uint64_t rounded(std::uint64_t x, int places) {
        if (places == 0) return x;
        return places > 63 ? 0 : (x + (UINT64_C(1) << (places - 1))) >> places;
    }

    std::uint64_t power_[kLines] = {};
    std::uint32_t blocks_ = 0;
    std::int32_t coarse_ = 0;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
