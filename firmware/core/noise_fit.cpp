#include "noise_fit.h"

#include <new>

#include "mpu9250.h"

namespace fltea {

namespace {

constexpr float kLsb = static_cast<float>(kGyroLsbTenths) / 10.0f;  // counts per deg/s
constexpr float kRateHz = 1e6f / static_cast<float>(settings::kSamplePeriodUs);
constexpr float kTurn = 6.2831853f;
// Of fewer samples nothing can be said.
constexpr uint32_t kFirstFit = 1000;
static_assert(settings::kFitEvery > 0, "samples from one round of fits to the next");

}  // namespace

void NoiseFit::begin() {
    passage_ = Octaves::Passage();
    stage_ = Stage::idle;
    age_ = 0;
    next_age_ = kFirstFit;
    started_ = 0;
    passing_ = false;
}

void NoiseFit::start(size_t i, float variance) {
    if (!(variance > 0)) return;
    new (storage_[i]) Axis(variance);
    started_ = static_cast<uint8_t>(started_ | 1u << i);
}

void NoiseFit::skip(uint16_t lost) {
    age_ += lost;
    for (size_t i = 0; i < kAxes; ++i) {
        if (is_started(i)) axis(i).octaves.skip(lost);
    }
}

void NoiseFit::add(size_t i, int16_t count) {
    if (i == 0) ++age_;
    if (!is_started(i)) return;
    axis(i).octaves.add(count, passage_);
    passing_ = passage_.n > 0 || passage_.cut;
    if (passing_) ++passages_;
    passing_axis_ = i;
}

void NoiseFit::pass() { passing_ = !axis(passing_axis_).octaves.pass(passage_); }

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
    bins_.begin();
}

NoiseFit::Told NoiseFit::work(Fit& fit, Spectrum& spectrum) {
    switch (stage_) {
        case Stage::idle:
            next_age_ = age_ + settings::kFitEvery;
            begin_axis(0);
            return Told::nothing;
        case Stage::gathering:
            // The spectrum has gone on: what was read of it does not fit the rest.
            if (gathered_ != passages_) begin_bins();
            if (!bins_.step(axis(axis_).octaves)) return Told::nothing;
            fit_.begin(bins_, whittle::kFivePercent, axis(axis_).memory);
            stage_ = Stage::fitting;
            return Told::nothing;
        case Stage::fitting:
            if (!fit_.work(bins_)) return Told::nothing;
            tell(fit);
            told_ = fit.number % settings::kSpectrumEvery == 1 ? 0 : bins_.size();
            stage_ = Stage::telling;
            return Told::fit;
        default:
            if (tell(spectrum)) return Told::spectrum;
            begin_axis(axis_ + 1);
            return Told::nothing;
    }
}

void NoiseFit::tell(Fit& fit) {
    const whittle::FitFigures& found = axis(axis_).memory.figures();
    fit = Fit();
    fit.axis = static_cast<fltea::Axis>(axis_);
    fit.verdict = static_cast<FitVerdict>(found.verdict);
    if (found.alpha_defined) fit.flags |= fit_flags::alpha_defined;
    if (fit_.searched()) fit.flags |= fit_flags::searched;
    if (bins_.left_out() > 0) fit.flags |= fit_flags::bins_left_out;
    fit.number = ++axis(axis_).fits;
    fit.age = bins_age_;
    fit.used = bins_used_;
    fit.evaluations = static_cast<uint16_t>(fit_.evaluations());
    fit.ordinates = found.ordinates;
    fit.alpha = found.alpha;
    fit.alpha_std = found.alpha_std;
    fit.f = found.g * math::exp(found.alpha * math::log(kRateHz));  // f = g h^-α
    fit.s2 = found.s2 / (kLsb * kLsb);
    fit.r = found.R / (kLsb * kLsb);
    fit.ratio_white = found.ratio_white;
    fit.ratio_relaxation = found.ratio_ar1;
}

// False when all has been told.
bool NoiseFit::tell(Spectrum& spectrum) {
    if (told_ >= bins_.size()) return false;
    spectrum = Spectrum();
    spectrum.axis = static_cast<fltea::Axis>(axis_);
    spectrum.number = axis(axis_).fits;
    spectrum.first = static_cast<uint8_t>(told_);
    spectrum.total = static_cast<uint8_t>(bins_.size());
    float* const frequency[] = {&spectrum.frequency_0, &spectrum.frequency_1, &spectrum.frequency_2,
                                &spectrum.frequency_3, &spectrum.frequency_4};
    float* const ordinates[] = {&spectrum.ordinates_0, &spectrum.ordinates_1, &spectrum.ordinates_2,
                                &spectrum.ordinates_3, &spectrum.ordinates_4};
    float* const density[] = {&spectrum.density_0, &spectrum.density_1, &spectrum.density_2,
                              &spectrum.density_3, &spectrum.density_4};
    for (size_t k = 0; k < sizeof frequency / sizeof *frequency && told_ < bins_.size(); ++k, ++told_) {
        *frequency[k] = bins_.lam(told_) * (kRateHz / kTurn);
        *ordinates[k] = bins_.counts(told_);
        *density[k] = bins_.power(told_) * (2.0f / (kRateHz * kLsb * kLsb));
    }
    return true;
}

}  // namespace fltea
