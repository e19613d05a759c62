// The device's own estimates. Samples wait in a queue and are processed one axis at a time, so that sampling
// never waits longer than one axis takes. If the queue is full when a sample comes, the sample is skipped and
// counted. The filters do not notice a skipped sample: they take the next sample as the one that follows. To
// predict the skipped sample would take as long as to process it. The same samples go into the spectra for
// the noise fits (noise_fit.h).
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "axis_estimator.h"
#include "messages.h"
#include "noise_fit.h"
#include "settings.h"

namespace fltea {

class Estimation {
  public:
    static constexpr size_t kAxes = 3;

    // Starts again with a new start-up window. Call this after the sensor was set up, because samples from
    // before do not fit those that follow.
    void begin() {
        for (AxisEstimator& axis : axes_) axis.begin();
        noise_.begin();
        waiting_ = 0;
        axis_ = 0;
        collected_ = 0;
        age_ = 0;
        skipped_in_row_ = 0;
        skipped_since_ = false;
        going_ = false;
        ++begun_;
    }

    // Adds a sample; `instant` is the number of its sampling instant. Returns true if it is the first sample
    // of a new start-up window.
    bool add(const Sample& sample, uint32_t instant) {
        const uint16_t begun = begun_;
        if (going_ && instant - instant_ - 1 > settings::kMaxGap) begin();
        if (waiting_ == kQueue) {
            if (skipped_in_row_ <= settings::kMaxGap) {
                ++skipped_in_row_;
                ++skipped_;
                skipped_since_ = true;
                instant_ = instant;
                return false;
            }
            begin();
        }
        Item& item = queue_[(first_ + waiting_) % kQueue];
        item.count[0] = sample.gyro_x;
        item.count[1] = sample.gyro_y;
        item.count[2] = sample.gyro_z;
        item.sequence = static_cast<uint16_t>(instant);
        item.missing = static_cast<uint16_t>(going_ ? instant - instant_ - 1 : 0);
        item.skipped = skipped_in_row_;
        skipped_in_row_ = 0;
        instant_ = instant;
        going_ = true;
        ++waiting_;
        return begun_ != begun;
    }

    // Sets the variances Q (of a step) and R (of the white noise) of an axis's filters to those of the fit of
    // its noise. Returns whether the filters now use that fit, which they do only if it rejects white noise
    // and has a definite order.
    bool retune(const Fit& fit) {
        if (fit.verdict == FitVerdict::white || (fit.flags & fit_flags::alpha_defined) == 0) return false;
        axes_[static_cast<size_t>(fit.axis)].retune(fit.s2, fit.r);
        return true;
    }

    bool busy() const { return waiting_ != 0 || noise_.passing(); }

    // Returns the noise fits, which use the same samples as the filters. Use them only when busy() is false.
    NoiseFit& noise() { return noise_; }
    const NoiseFit& noise() const { return noise_; }

    // Does one slice of work. It advances the filters of one axis by one sample, or takes the newest samples
    // of one axis through one level of its running spectrum. Returns true if `message` is a new ESTIMATE to
    // be sent.
    bool work(Estimate& message) {
        if (noise_.passing()) {
            noise_.pass();
            return false;
        }
        Item& item = queue_[first_];
        if (collected_ < settings::kStartup) {
            collect(item);
            return false;
        }
        const bool bridging = item.missing != 0;
        if (axis_ == 0) ++age_;
        axes_[axis_].step(bridging ? nullptr : &item.count[axis_]);
        if (settings::kFit) add_to_spectrum(item, bridging);
        const bool due = !bridging && item.sequence % settings::kEstimateEvery == 0;
        if (due) {
            message = Estimate();
            axes_[axis_].report(message);
            if (settings::kFit) noise_.track(axis_, message);
            message.axis = static_cast<Axis>(axis_);
            if (skipped_since_) message.flags |= estimate_flags::skipped;
            message.sample = item.sequence;
            message.age = age_;
        }
        if (++axis_ == kAxes) {
            axis_ = 0;
            if (bridging) {
                --item.missing;
            } else {
                next();
            }
        }
        return due;
    }

    // Fills the settings and the state of the estimation into an ESTIMATOR message, except longest_axis and
    // longest_slice, which the caller fills in.
    void report(Estimator& message) const {
        namespace s = settings;
        message = Estimator();
        message.variant = s::kVariant;
        message.guard = s::kGuard;
        message.startup = s::kStartup;
        message.max_gap = s::kMaxGap;
        message.every = s::kEstimateEvery;
        message.fit_every = s::kFit ? s::kFitEvery : 0;
        message.remaining = static_cast<uint16_t>(s::kStartup - collected_);
        message.begun = begun_;
        message.queue = static_cast<uint16_t>(waiting_);
        message.skipped = skipped_;
        uint16_t* const restarts[] = {&message.restarts_x, &message.restarts_y, &message.restarts_z};
        float* const bias[] = {&message.bias_x, &message.bias_y, &message.bias_z};
        float* const r[] = {&message.r_x, &message.r_y, &message.r_z};
        for (size_t i = 0; i < kAxes; ++i) {
            *restarts[i] = axes_[i].restarts();
            *bias[i] = axes_[i].bias_dps();
            *r[i] = axes_[i].r_dps2();
        }
        AxisEstimator::describe(message);
    }

    // Whether the start-up window is full.
    bool started() const { return collected_ == settings::kStartup; }

  private:
    // Samples that the queue can hold. Processing a gap of kMaxGap samples takes a tenth of a second. The
    // queue has to hold the samples that come in this time.
    static constexpr size_t kQueue = 32;
    static_assert(settings::kStartup >= 2 && settings::kStartup <= 4096, "the window's sums must fit");
    static_assert(settings::kEstimateEvery >= 1, "samples from one ESTIMATE to the next");

    struct Item {
        int16_t count[kAxes];
        uint16_t sequence;
        // number of lost samples just before this one that the filters still have to predict
        uint16_t missing;
        // number of samples just before this one that were skipped because the queue was full
        uint16_t skipped;
    };

    void collect(const Item& item) {
        for (size_t i = 0; i < kAxes; ++i) axes_[i].collect(item.count[i]);
        next();
        if (++collected_ != settings::kStartup) return;
        for (size_t i = 0; i < kAxes; ++i) {
            axes_[i].start();
            // An axis whose samples are all equal is not a working gyroscope axis, so its noise is not
            // fitted.
            if (settings::kFit && axes_[i].variance() > 0) noise_.start(i);
        }
    }

    void add_to_spectrum(const Item& item, bool bridging) {
        if (!bridging) {
            if (axis_ == 0 && item.skipped > 0) noise_.skip(item.skipped);
            noise_.add(axis_, item.count[axis_]);
        } else if (axis_ == 0) {
            noise_.skip(1);
        }
    }

    void next() {
        first_ = (first_ + 1) % kQueue;
        --waiting_;
    }

    AxisEstimator axes_[kAxes];
    NoiseFit noise_;
    Item queue_[kQueue] = {};
    size_t first_ = 0;
    size_t waiting_ = 0;
    size_t axis_ = 0;       // axis whose filters process their sample next
    uint32_t instant_ = 0;  // number of the newest sample
    uint32_t age_ = 0;
    uint32_t skipped_ = 0;
    uint16_t skipped_in_row_ = 0;
    uint16_t collected_ = 0;
    uint16_t begun_ = 0;
    bool going_ = false;  // a sample has come since begin()
    bool skipped_since_ = false;
};

}  // namespace fltea
