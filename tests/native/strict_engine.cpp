// This file is only compiled, with the device's flags, and never run. It shows that the filters compile for
// every number type and memory.
#include "baseline.hpp"
#include "count_spectrum.hpp"
#include "fit_bins.hpp"
#include "lane.hpp"
#include "memory_compressed.hpp"
#include "memory_direct.hpp"
#include "sliced_fit.hpp"
#include "supervisor.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

#define FLTEA_USE(Number)                                                  \
    template class Lane<Number, Triple<Number>, DirectMemory<Number>>;     \
    template class Lane<Number, Triple<Number>, CompressedMemory<Number>>; \
    template class Lane<Number, Joint<Number>, DirectMemory<Number>>;      \
    template class Lane<Number, Joint<Number>, CompressedMemory<Number>>

typedef Pack<double, kWidth> Wide;
FLTEA_USE(float);
FLTEA_USE(double);
FLTEA_USE(Wide);
template class Supervisor<float>;
template class Supervisor<double>;

float use(CountOctaves<>& octaves);
float use(CountOctaves<>& octaves) {
    octaves.add(1);
    octaves.skip(1);
    float power[CountOctaves<>::Ladder::kTopLines], blocks = 0, effective = 0;
    octaves.ladder().sums(0, octaves.now(), power, &blocks, &effective);
    return blocks + static_cast<float>(octaves.exponent(1));
}

typedef FitBins<CountOctaves<>> DeviceBins;
float use(const CountOctaves<>& octaves, DeviceBins& bins, whittle::SlicedFit<DeviceBins>& fit,
          whittle::FitMemory& memory);
float use(const CountOctaves<>& octaves, DeviceBins& bins, whittle::SlicedFit<DeviceBins>& fit,
          whittle::FitMemory& memory) {
    bins.begin();
    while (!bins.step(octaves)) {
    }
    fit.begin(bins, whittle::kOnePercent, memory);
    while (!fit.work(bins)) {
    }
    return memory.figures().alpha;
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
