// The device's running spectrum and fit of one axis behind a C interface, for tests in Python: a shared
// library.
#include <cstddef>
#include <cstdint>
#include <new>

#include "fit_bins.hpp"
#include "sliced_fit.hpp"

namespace {

typedef fltea::engine::CountOctaves<> Octaves;
typedef fltea::engine::FitBins<Octaves> Bins;

struct Axis {
    Octaves octaves;
    Bins bins;
    fltea::whittle::SlicedFit<Bins> fit;
    fltea::whittle::FitMemory memory;
};

}  // namespace

extern "C" {
Axis* spectrum_make() { return new Axis; }
void spectrum_free(Axis* axis) { delete axis; }
void spectrum_add(Axis* axis, std::size_t n, const std::int16_t* counts) {
    for (std::size_t k = 0; k < n; ++k) axis->octaves.add(counts[k]);
}
void spectrum_skip(Axis* axis, std::size_t lost) { axis->octaves.skip(lost); }
// verdict, α, its standard deviation, g, s2, R, 2 log L above white noise, and above AR(1), ordinates,
// whether α is defined, evaluations: eleven numbers.
void spectrum_fit(Axis* axis, double* out) {
    axis->bins.begin();
    while (!axis->bins.step(axis->octaves)) {
    }
    axis->fit.begin(axis->bins, fltea::whittle::kFivePercent, axis->memory);
    while (!axis->fit.work(axis->bins)) {
    }
    const fltea::whittle::FitFigures& found = axis->memory.figures();
    const float numbers[] = {static_cast<float>(found.verdict),
                             found.alpha,
                             found.alpha_std,
                             found.g,
                             found.s2,
                             found.R,
                             found.ratio_white,
                             found.ratio_ar1,
                             found.ordinates,
                             found.alpha_defined ? 1.0f : 0.0f,
                             static_cast<float>(axis->fit.evaluations())};
    for (float one : numbers) *out++ = static_cast<double>(one);
}
}
