// Fits the noise of each axis by maximum likelihood: keeps a running spectrum of its counts, and fits a model
// to it every few seconds. The filter of that model then tracks the axis. All work is done in slices of about
// a millisecond at most, so that sampling never waits for a fit. The implementation is in noise_fit.cpp.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "messages.h"
#include "settings.h"

namespace fltea {

class NoiseFit {
  public:
    static constexpr size_t kAxes = 3;

    NoiseFit();
    NoiseFit(const NoiseFit&) = delete;
    NoiseFit& operator=(const NoiseFit&) = delete;

    // Forgets all samples and fits. After this, start() has to start each axis anew.
    void begin();

    // Starts the spectrum, the fits and the tracker of an axis. Call this when the axis's start-up window is
    // full. The samples of an axis that is not started are ignored.
    void start(size_t axis);

    // Notes that before the next sample, `lost` samples of all axes are missing.
    void skip(uint16_t lost);
    // Adds the sample of one axis, as a count of the sensor. Call this for axis 0, 1 and 2 of each sample, in
    // this order, but not while passing() is true.
    void add(size_t axis, int16_t count);

    // New samples go through the levels of the running spectrum one after another. passing() says whether
    // some still have levels before them, and pass() does one slice of that work. Call pass() until passing()
    // is false, before any other function.
    bool passing() const { return passing_; }
    void pass();

    // Fills the bias and the state of an axis's tracker into an ESTIMATE message, if a fit has given the
    // tracker a filter.
    void track(size_t axis, Estimate& message);

    // Whether a fit is due or in progress.
    bool busy() const { return stage_ != Stage::idle || (started_ != 0 && is_due()); }
    // Which message a call of work() has filled in. The caller has to send that message before the next call.
    enum class Told { nothing, fit, spectrum };
    Told work(Fit& fit, Spectrum& spectrum);

  private:
    // The spectra, bins and fits. Their classes come from engine/, which is included only in noise_fit.cpp.
    struct Parts;
    struct Axis;
    enum class Stage { idle, gathering, fitting, designing, telling };

    Parts& parts() { return *reinterpret_cast<Parts*>(storage_); }
    Axis& axis(size_t i);
    // Whether the next fit is due. This is correct even if age_ (a number of samples) has wrapped at 2^32,
    // which happens after more than a year at 100 Hz.
    bool is_due() const { return static_cast<int32_t>(age_ - next_age_) >= 0; }
    bool is_started(size_t i) const { return (started_ >> i & 1) != 0; }
    void begin_axis(size_t first);
    void begin_bins();
    void judge_motion();
    void tell(Fit& fit);
    bool tell(Spectrum& spectrum);

    static constexpr size_t kBytes = 42120;
    alignas(8) unsigned char storage_[kBytes];
    Stage stage_ = Stage::idle;
    size_t axis_ = 0;        // axis that is being fitted
    uint32_t passages_ = 0;  // how often samples have entered the spectrum of any axis, since boot
    uint32_t gathered_ = 0;  // value of passages_ when the bins in progress were begun
    uint32_t age_ = 0;       // number of samples since the start-up window, including lost ones
    uint32_t next_age_ = 0;  // number of samples, counted as in age_, at which the next round of fits is due
    uint32_t bins_age_ = 0;  // number of samples, counted as in age_, when the bins of the fit were begun
    uint32_t bins_used_ = 0;
    int told_ = 0;             // number of bins of the present spectrum that were sent
    size_t passing_axis_ = 0;  // axis of the samples that pass() takes through a spectrum
    uint8_t started_ = 0;      // one bit per axis: whether the axis is started
    bool passing_ = false;
};

}  // namespace fltea
