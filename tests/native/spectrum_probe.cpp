// A C interface to the device's running spectrum, fit and tracker of one axis. It is a shared library for
// tests in Python.
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <new>

#include "fit_bins.hpp"
#include "sensor_motion.hpp"
#include "sliced_fit.hpp"

namespace {

typedef fltea::engine::CountOctaves<> Octaves;
typedef fltea::engine::FitBins<Octaves> Bins;

struct Axis {
    Octaves octaves;
    Bins bins;
    fltea::whittle::SlicedFit<Bins> fit;
    fltea::whittle::FitMemory memory;
    fltea::whittle::TrackedState tracked;
    fltea::whittle::SensorMotion motion;
    int ahead = 0;
};

void design(Axis* axis, const fltea::whittle::FitFigures& figures) {
    fltea::whittle::FilterDesign design;
    design.begin(figures, axis->ahead);
    while (!design.work()) {
    }
    axis->tracked.set(design.filter());
}

}  // namespace

extern "C" {
// Makes an axis. Its tracker gives the mean of the bias over the next `ahead` samples, or the present bias if
// `ahead` is 0.
Axis* spectrum_make(int ahead) {
    Axis* axis = new Axis;
    axis->ahead = ahead;
    return axis;
}
void spectrum_free(Axis* axis) { delete axis; }
void spectrum_add(Axis* axis, std::size_t n, const std::int16_t* counts) {
    for (std::size_t k = 0; k < n; ++k) axis->octaves.add(counts[k]);
}
void spectrum_skip(Axis* axis, std::size_t lost) { axis->octaves.skip(lost); }
// Fits the running spectrum, and writes eleven numbers:
//   verdict; order α; standard deviation of α;
//   g = h^α f, where h is the sampling period; variance s2 of a step of the noise that drives the order;
//   variance R of the white noise;
//   2 log L of the best order up to 1, minus that of white noise;
//   2 log L of the best order, minus that of a relaxation, AR(1);
//   number of periodogram values in the fit; whether α is defined; number of evaluations of the likelihood.
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
// Replaces the tracker's filter by one for the model of the last fit, from the next sample on.
void spectrum_retrack(Axis* axis) { design(axis, axis->memory.figures()); }
// Replaces the tracker's filter by one for a given model. `given` has the verdict, then α, g, s2 and R of an
// order (as in spectrum_fit). For a relaxation, AR(1) with the coefficient φ, it has instead 1 - φ, the
// variance of the relaxation and that of the white noise.
void spectrum_design(Axis* axis, const double* given) {
    fltea::whittle::FitFigures figures = fltea::whittle::FitFigures();
    figures.verdict = static_cast<fltea::whittle::Verdict>(static_cast<int>(given[0]));
    figures.alpha = figures.relaxation_fall = static_cast<float>(given[1]);
    figures.g = figures.relaxation_variance = static_cast<float>(given[2]);
    figures.s2 = figures.relaxation_R = static_cast<float>(given[3]);
    figures.R = static_cast<float>(given[4]);
    design(axis, figures);
}
// Processes n samples of `axes`, the axes of one sensor. `counts` has the counts of all axes for the first
// sample, then for the second, and so on. Writes four numbers for each sample and axis: bias, standard
// deviation of the bias, state, and standard deviation of the state. The four are 0 as long as the tracker
// has no filter. Also writes for each sample whether the sensor moves.
void spectrum_track(Axis* const* axes, int n_axes, std::size_t n, const std::int16_t* counts, double* out) {
    const fltea::whittle::SensorMotion::Limits limits = {32.8f, 31, 1875};
    fltea::whittle::SensorMotion& motion = axes[0]->motion;
    fltea::whittle::TrackedState* tracked[8];
    for (int i = 0; i < n_axes; ++i) tracked[i] = &axes[i]->tracked;
    for (std::size_t k = 0; k < n; ++k) {
        for (int i = 0; i < n_axes; ++i) tracked[i]->next(*counts++, motion.moving());
        motion.next(tracked, n_axes, limits);
        for (int i = 0; i < n_axes; ++i) {
            fltea::whittle::TrackedState::Figures f = fltea::whittle::TrackedState::Figures();
            if (tracked[i]->known()) f = tracked[i]->figures(motion.unlearned());
            for (float one : {f.bias, f.bias_std, f.state, f.state_std}) *out++ = static_cast<double>(one);
            *out++ = motion.moving() ? 1 : 0;
        }
    }
}
void spectrum_lose(Axis* axis, std::size_t lost) {
    axis->motion.skip(static_cast<std::uint32_t>(lost));
    axis->tracked.skip(static_cast<std::uint32_t>(lost));
}
}
