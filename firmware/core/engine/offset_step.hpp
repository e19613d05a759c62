// Detects a step in the offset of white noise (Page 1954). The samples come in chunks, and the means of the
// chunks enter two cumulative sums, one for steps up and one for steps down. The test is designed for steps
// of one standard deviation of such a mean. With chunks of 32 samples, such a step is 0.18 standard
// deviations of a single sample. Larger steps are detected sooner.
#ifndef FLTEA_OFFSET_STEP_HPP
#define FLTEA_OFFSET_STEP_HPP

#include <cstdint>

#include "instruction_set.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

class OffsetStep {
  public:
    OffsetStep() { clear(); }

    void clear() {
        sums_[0] = sums_[1] = 0;
        chunks_[0] = chunks_[1] = 0;
    }

    // Adds the mean of a chunk; `deviation` is the standard deviation of such a mean. Returns how many chunks
    // ago a step began, and writes the step's height to `size`. Returns 0 if there is no step.
    std::uint16_t add(float mean, float deviation, float& size) {
        for (int side = 0; side < 2; ++side) {
            sums_[side] += (side == 0 ? mean : -mean) - kSlack * deviation;
            if (!(sums_[side] > 0) || chunks_[side] == 0xFFFF) {
                sums_[side] = 0;
                chunks_[side] = 0;
                continue;
            }
            ++chunks_[side];
            if (sums_[side] < kLimit * deviation) continue;
            size = sums_[side] / static_cast<float>(chunks_[side]) + kSlack * deviation;
            if (side == 1) size = -size;
            return chunks_[side];
        }
        return 0;
    }

  private:
    // Each cumulative sum grows by a chunk's mean minus `kSlack`, and never falls below 0. A sum that reaches
    // `kLimit` is a step. Both constants are in standard deviations of a chunk's mean. With noise alone, one
    // sum reaches the limit 15 once in 2.1e7 chunks (Siegmund 1985, eq. 2.57). Three axes at 100 Hz with
    // chunks of 32 samples and two sums per axis add 3 * 2 * 100 / 32 = 18.75 chunks per second to a sum. So
    // there is one false step in 2.1e7 / 18.75 s = 13 days.
    static constexpr float kSlack = 0.5f, kLimit = 15;

    float sums_[2];
    // for each of the sums (steps up, steps down): number of chunks since it was last 0
    std::uint16_t chunks_[2];
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
