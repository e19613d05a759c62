// The noise of each axis by maximum likelihood: a running spectrum of its counts, and every few seconds the
// fit of a model to it, whose filter tracks the axis from then on. All in slices of at most a millisecond or
// so, of which none waits for another, so that sampling never waits for a fit. Its work is in noise_fit.cpp.
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

    // Forgets everything, until start().
    void begin();

    // The start-up window is full. An axis that is not started is left out.
    void start(size_t axis);

    // So many samples of all axes are missing before the next one.
    void skip(uint16_t lost);
    // A count of an axis, of each in turn. Not while passing().
    void add(size_t axis, int16_t count);

    // Counts are on their way down the octaves: a slice of it. Nothing else before it has come to its end.
    bool passing() const { return passing_; }
    void pass();

    // Fills in the tracker's figures of an axis, if there are any.
    void track(size_t axis, Estimate& message);

    // A fit is due or on its way.
    bool busy() const { return stage_ != Stage::idle || (started_ != 0 && is_due()); }
    // What a slice has led to: what is to be sent before the next one.
    enum class Told { nothing, fit, spectrum };
    Told work(Fit& fit, Spectrum& spectrum);

  private:
    // Spectra, bins and fit: of the engine, which is compiled once, in noise_fit.cpp.
    struct Parts;
    struct Axis;
    enum class Stage { idle, gathering, fitting, designing, telling };

    Parts& parts() { return *reinterpret_cast<Parts*>(storage_); }
    Axis& axis(size_t i);
    // Ages pass 2^32 in more than a year, or in a hundred days at 500 Hz.
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
    size_t axis_ = 0;        // that is being fitted
    uint32_t passages_ = 0;  // of all axes since begin()
    uint32_t gathered_ = 0;  // those when the bins were begun
    uint32_t age_ = 0;       // samples since the window, lost ones included
    uint32_t next_age_ = 0;  // from which on a fit is due
    uint32_t bins_age_ = 0;  // when the bins were begun
    uint32_t bins_used_ = 0;
    int told_ = 0;             // bins of a spectrum
    size_t passing_axis_ = 0;  // whose counts are on their way
    uint8_t started_ = 0;      // a bit for each axis
    bool passing_ = false;
};

}  // namespace fltea
