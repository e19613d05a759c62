#include "noise_fit.h"

#include <new>

#include "engine/count_spectrum.hpp"
#include "engine/fit_bins.hpp"
#include "engine/sensor_motion.hpp"
#include "engine/sliced_fit.hpp"
#include "mpu9250.h"

namespace fltea {

namespace {

// sensitivity of the gyroscope [counts per deg/s]
constexpr float kLsb = static_cast<float>(kGyroLsbTenths) / 10.0f;
constexpr float kRateHz = 1e6f / static_cast<float>(settings::kSamplePeriodUs);
constexpr float kTurn = 6.2831853f;
// Number of samples before the first fit.
constexpr uint32_t kFirstFit = 1000;
// The bias that the tracker gives is the expected mean of the next second. This is its number of samples.
constexpr int kAhead = 1000000 / settings::kSamplePeriodUs;
constexpr float kChunksPerS = kRateHz / static_cast<float>(+whittle::AxisMotion::kChunk);
// When a change of the mean rate is accepted as a step of the bias, and no longer taken for motion: after ten
// seconds at the new mean, or after ten minutes if the change is 2 deg/s or more. So much is not expected of
// a bias, by its dependence on temperature in the data sheets.
constexpr whittle::SensorMotion::Limits kMotion = {2 * kLsb, static_cast<uint16_t>(10 * kChunksPerS),
                                                   static_cast<uint16_t>(600 * kChunksPerS)};
static_assert(settings::kFitEvery > 0, "samples from one round of fits to the next");

typedef engine::CountOctaves<> Octaves;
typedef engine::FitBins<Octaves> Bins;

}  // namespace

struct NoiseFit::Axis {
    // Every twelfth fit of an axis also tests whether some points of a grid are better starts of the search.
    // The axes do so in turn, four fits apart, so that only one round of fits in four contains such a test.
    explicit Axis(size_t i) : memory(4 * static_cast<int>(i)) {}
    Octaves octaves;
    whittle::FitMemory memory;
    whittle::TrackedState tracked;
    uint16_t fits = 0;
};

struct NoiseFit::Parts {
    // memory for an object of type Axis per axis, which is constructed when the axis is started
    alignas(8) unsigned char axes[kAxes][sizeof(Axis)];
    whittle::SensorMotion motion;
    Octaves::Passage passage;
    Bins bins;
    whittle::SlicedFit<Bins> fit;
    whittle::FilterDesign design;
};

NoiseFit::NoiseFit() {
    static_assert(sizeof(Parts) <= kBytes && alignof(Parts) <= 8, "the parts fit their storage");
    new (storage_) Parts;
}

NoiseFit::Axis& NoiseFit::axis(size_t i) { return *reinterpret_cast<Axis*>(parts().axes[i]); }

void NoiseFit::begin() {
    parts().passage = Octaves::Passage();
    parts().motion = whittle::SensorMotion();
    stage_ = Stage::idle;
    age_ = 0;
    next_age_ = kFirstFit;
    started_ = 0;
    passing_ = false;
}

void NoiseFit::start(size_t i) {
    new (parts().axes[i]) Axis(i);
    started_ = static_cast<uint8_t>(started_ | 1u << i);
}

void NoiseFit::skip(uint16_t lost) {
    age_ += lost;
    parts().motion.skip(lost);
    for (size_t i = 0; i < kAxes; ++i) {
        if (!is_started(i)) continue;
        axis(i).octaves.skip(lost);
        axis(i).tracked.skip(lost);
    }
}

void NoiseFit::add(size_t i, int16_t count) {
    if (i == 0) ++age_;
    if (is_started(i)) {
        Octaves::Passage& passage = parts().passage;
        axis(i).octaves.add(count, passage);
        axis(i).tracked.next(count, parts().motion.moving());
        passing_ = passage.n > 0 || passage.cut;
        if (passing_) ++passages_;
        passing_axis_ = i;
    }
    if (i == kAxes - 1) judge_motion();
}

// Judges whether the sensor moves. Call this for each sample, after its counts were added for all axes.
void NoiseFit::judge_motion() {
    whittle::TrackedState* tracked[kAxes];
    int n = 0;
    for (size_t i = 0; i < kAxes; ++i) {
        if (is_started(i)) tracked[n++] = &axis(i).tracked;
    }
    parts().motion.next(tracked, n, kMotion);
}

void NoiseFit::pass() { passing_ = !axis(passing_axis_).octaves.pass(parts().passage); }

void NoiseFit::begin_axis(size_t first) {
    for (size_t i = first; i < kAxes; ++i) {
        if (!is_started(i)) continue;
        axis_ = i;
        stage_ = Stage::gathering;
        begin_bins();
        return;
    }
    stage_ = Stage::idle;
}

void NoiseFit::begin_bins() {
    gathered_ = passages_;
    bins_age_ = age_;
    bins_used_ = static_cast<uint32_t>(axis(axis_).octaves.counts().used);
    parts().bins.begin();
}

NoiseFit::Told NoiseFit::work(Fit& fit, Spectrum& spectrum) {
    Bins& bins = parts().bins;
    switch (stage_) {
        case Stage::idle:
            next_age_ = age_ + settings::kFitEvery;
            begin_axis(0);
            return Told::nothing;
        case Stage::gathering:
            // The bins are made from the spectrum in several calls. If samples enter the spectrum meanwhile,
            // the bins are made anew, since they would mix two states of the spectrum.
            if (gathered_ != passages_) begin_bins();
            if (!bins.step(axis(axis_).octaves)) return Told::nothing;
            parts().fit.begin(bins, whittle::kFivePercent, axis(axis_).memory);
            stage_ = Stage::fitting;
            return Told::nothing;
        case Stage::fitting:
            if (!parts().fit.work(bins)) return Told::nothing;
            parts().design.begin(axis(axis_).memory.figures(), kAhead);
            stage_ = Stage::designing;
            return Told::nothing;
        case Stage::designing:
            if (!parts().design.work()) return Told::nothing;
            if (axis(axis_).memory.figures().verdict != whittle::Verdict::none)
                axis(axis_).tracked.set(parts().design.filter());
            tell(fit);
            told_ = fit.number % settings::kSpectrumEvery == 1 ? 0 : bins.size();
            stage_ = Stage::telling;
            return Told::fit;
        default:
            if (tell(spectrum)) return Told::spectrum;
            begin_axis(axis_ + 1);
            return Told::nothing;
    }
}

void NoiseFit::track(size_t i, Estimate& message) {
    if (!is_started(i) || !axis(i).tracked.known()) return;
    const whittle::TrackedState::Figures found = axis(i).tracked.figures(parts().motion.unlearned());
    message.flags |= estimate_flags::tracked;
    message.tracker_bias = found.bias / kLsb;
    message.tracker_bias_std = found.bias_std / kLsb;
    message.tracker_state = found.state / kLsb;
    message.tracker_state_std = found.state_std / kLsb;
}

void NoiseFit::tell(Fit& fit) {
    const whittle::FitFigures& found = axis(axis_).memory.figures();
    const Bins& bins = parts().bins;
    fit = Fit();
    fit.axis = static_cast<fltea::Axis>(axis_);
    fit.verdict = static_cast<FitVerdict>(found.verdict);
    if (found.alpha_defined) fit.flags |= fit_flags::alpha_defined;
    if (parts().fit.searched()) fit.flags |= fit_flags::searched;
    if (bins.left_out() > 0) fit.flags |= fit_flags::bins_left_out;
    fit.number = ++axis(axis_).fits;
    fit.age = bins_age_;
    fit.used = bins_used_;
    fit.evaluations = static_cast<uint16_t>(parts().fit.evaluations());
    fit.ordinates = found.ordinates;
    fit.alpha = found.alpha;
    fit.alpha_std = found.alpha_std;
    // f of D^α x = f x + ω, in s^-α; found.g is f h^α, where h is the sampling period
    fit.f = found.g * math::exp(found.alpha * math::log(kRateHz));
    fit.s2 = found.s2 / (kLsb * kLsb);
    fit.r = found.R / (kLsb * kLsb);
    fit.ratio_white = found.ratio_white;
    fit.ratio_relaxation = found.ratio_ar1;
}

// Fills the next bins of the spectrum into a SPECTRUM frame. Returns false if all bins were sent before.
bool NoiseFit::tell(Spectrum& spectrum) {
    const Bins& bins = parts().bins;
    if (told_ >= bins.size()) return false;
    spectrum = Spectrum();
    spectrum.axis = static_cast<fltea::Axis>(axis_);
    spectrum.number = axis(axis_).fits;
    spectrum.first = static_cast<uint8_t>(told_);
    spectrum.total = static_cast<uint8_t>(bins.size());
    float* const frequency[] = {&spectrum.frequency_0, &spectrum.frequency_1, &spectrum.frequency_2,
                                &spectrum.frequency_3, &spectrum.frequency_4};
    float* const ordinates[] = {&spectrum.ordinates_0, &spectrum.ordinates_1, &spectrum.ordinates_2,
                                &spectrum.ordinates_3, &spectrum.ordinates_4};
    float* const density[] = {&spectrum.density_0, &spectrum.density_1, &spectrum.density_2,
                              &spectrum.density_3, &spectrum.density_4};
    for (size_t k = 0; k < sizeof frequency / sizeof *frequency && told_ < bins.size(); ++k, ++told_) {
        *frequency[k] = bins.lam(told_) * (kRateHz / kTurn);
        *ordinates[k] = bins.counts(told_);
        *density[k] = bins.power(told_) * (2.0f / (kRateHz * kLsb * kLsb));
    }
    return true;
}

}  // namespace fltea
