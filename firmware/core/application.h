// The whole device except its hardware. The code for a board creates one Application, calls its start() once
// and then its step() forever.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "allowance.h"
#include "build_id.h"
#include "byte_sink.h"
#include "clock.h"
#include "estimation.h"
#include "faults.h"
#include "health.h"
#include "i2c_bus.h"
#include "link.h"
#include "messages.h"
#include "reset_cause.h"
#include "sampler.h"
#include "settings.h"
#include "timers.h"
#include "workload.h"

namespace fltea {

// What the code for one kind of board has found out about the board on which it runs.
struct Identity {
    uint32_t boot_id;       // a number that differs from boot to boot
    uint8_t device_id[16];  // unique identifier of the microcontroller
    const char* port;       // name of the port of the firmware: "due" or "arduino"
    ResetCause reset_cause;
};

class Application {
  public:
    Application(I2cBus& bus, ByteSink& sink, Clock& clock, const Identity& identity,
                SamplingMode mode = settings::kSamplingMode)
        : clock_(clock),
          identity_(identity),
          mode_(mode),
          link_(sink),
          health_(bus, clock, faults_, mode),
          sampler_(mode) {}

    // Starts the device and sends HELLO. Call this once, before the first step().
    void start() {
        const uint32_t now_us = clock_.now_us();
        sampler_.begin(now_us);
        // HELLO and STATUS are sent in the middle between two sampling instants. On a board that does not
        // sleep, a sampling instant might otherwise have to wait until these frames are written.
        const uint32_t mid_us = now_us - now_us % kPeriodUs - kPeriodUs / 2;
        hello_.begin(mid_us);
        status_.begin(mid_us + kSecondUs / 2 / kPeriodUs * kPeriodUs);
        workload_.begin(now_us);
        fits_share_.begin(now_us);
        report(now_us);
    }

    // Call this in the main loop, after every wake-up and at least every 10 ms. It returns within 10 ms,
    // whatever the I2C bus does. Returns true if more work can be done at once.
    bool step() {
        const uint32_t now_us = clock_.now_us(), transfers = health_.transfers();
        health_.pass_time(now_us);
        const bool due = sampler_.poll(now_us);
        if (health_.running()) {
            const uint32_t silence_us = sampler_.silence_us(now_us);
            if (due) {
                take_sample();
            } else if (silence_us >= kMostSilenceUs) {
                health_.data_ready_missing(silence_us);
            }
            if (!health_.running()) sampler_.sensor_stops();
        } else {
            if (due) sampler_.missed();
            if (health_.set_up(now_us)) {
                sampler_.sensor_runs(now_us);
                estimation_.begin();
                forget_estimates();
            }
        }
        const bool worked = estimate(clock_.now_us()) || fit(clock_.now_us());
        const uint32_t done_us = clock_.now_us();
        report(done_us);
        if (worked || health_.transfers() != transfers) workload_.add(clock_.now_us() - now_us);
        return may_estimate(done_us) || may_fit(done_us);
    }

    // Call this from the interrupt handler of the data-ready pin, with the time of the edge.
    void on_data_ready(uint32_t now_us) { sampler_.on_data_ready(now_us); }

  private:
    // The compiler checks that the serial port can take all bytes of a second with a tenth of its capacity
    // still free. These bytes include HELLO, ESTIMATOR, STATUS, one FAULT and one FIT.
    static constexpr uint32_t kPeriodUs = settings::kSamplePeriodUs;
    static constexpr size_t kSamplesPerS = kSecondUs / settings::kSamplePeriodUs;
    // Largest number of SPECTRUM messages per second. Each of three axes is fitted every kFitEvery samples.
    // After one in kSpectrumEvery of these fits, up to 176 bins of the spectrum are sent, five in each
    // message.
    static constexpr size_t kMostSpectraPerS =
        kSamplesPerS * 3 * 176 / 5 / settings::kFitEvery / settings::kSpectrumEvery + 1;
    static constexpr size_t kBytesPerS =
        kSamplesPerS * wire_size<Sample>() + wire_size<Hello>() + wire_size<Status>() + wire_size<Fault>() +
        (settings::kEstimate
             ? kSamplesPerS * Estimation::kAxes * wire_size<Estimate>() / settings::kEstimateEvery +
                   wire_size<Estimator>()
             : 0) +
        (settings::kFit ? wire_size<Fit>() + kMostSpectraPerS * wire_size<Spectrum>() : 0);
    static_assert(
        kBytesPerS < settings::kLineBaud / 10 * 9 / 10,
        "the line has to take all that is to be said: another FLTEA_RATE_HZ, FLTEA_BAUD or kEstimateEvery");
    // Time on the I2C bus for reading a sample and the registers that show whether the sensor is still set
    // up. A byte takes nine clock cycles of the bus. The 6 bytes are the addresses and register numbers of
    // the two transfers.
    static constexpr uint32_t kReadUs =
        (Mpu9250::kBurstBytes + Mpu9250::kGuardBytes + 6) * 9 * 1000000 / settings::kI2cHz;
    static_assert(kReadUs < settings::kSamplePeriodUs * 3 / 4, "the bus has to take all samples");
    // Estimates need a sampling period of at least 2 ms, for two reasons. The estimates of three axes take
    // 1.1 ms of processor time per sample. And the message ESTIMATOR may be sent half a period after a
    // sample. A send buffer as small as Arduino's must then have room for it (Link::send).
    static_assert(!settings::kEstimate || settings::kSamplePeriodUs >= 2000, "too fast for estimates");

    static constexpr uint32_t kLateUs = settings::kSamplePeriodUs / 10;
    static constexpr uint32_t kMostSilenceUs =
        settings::kSamplePeriodUs < 10000 ? 50000 : 5 * settings::kSamplePeriodUs;

    void take_sample() {
        Health::Reading reading;
        // No sample is sent before the HELLO that announces the present set-up of the sensor.
        if (announced_starts_ != health_.sensor_starts() || !health_.read(reading)) {
            sampler_.missed();
            return;
        }
        sampler_.burst_began(reading.burst_us);
        const uint32_t due_us = sampler_.due_us();
        if (reading.burst_us - due_us > kLateUs) reading.sample.flags |= sample_flags::late;
        const uint32_t device_us = mode_ == SamplingMode::data_ready ? due_us : reading.burst_us;
        link_.send_sample(reading.sample, sampler_.sequence(), device_us);
        if (settings::kEstimate && estimation_.add(reading.sample, sampler_.instant())) forget_estimates();
    }

    // Drops the estimators' results that were not sent yet, because they belong to an earlier start-up
    // window.
    void forget_estimates() { estimate_due_ = fit_due_ = spectrum_due_ = false; }

    // Whether there is time to estimate one axis. There is no time while the previous estimate waits to be
    // sent, or if the next sampling instant would have to wait. An estimate is assumed to take as long as the
    // longest one so far, but at most half a sampling period.
    bool may_estimate(uint32_t now_us) const {
        const uint32_t most_us = settings::kSamplePeriodUs / 2;
        return estimation_.busy() && !estimate_due_ && !estimator_due_ &&
               sampler_.until_next_us(now_us) > (longest_axis_us_ < most_us ? longest_axis_us_ : most_us);
    }

    // Whether there is time for a slice of a fit, which is a small part of its computation. There is time
    // only if no estimate is due, if the fits have not used up their proportion of the processor time, and if
    // the next sampling instant does not have to wait.
    bool may_fit(uint32_t now_us) const {
        const uint32_t most_us = settings::kSamplePeriodUs / 2;
        return settings::kFit && estimation_.noise().busy() && !estimation_.busy() && !fit_due_ &&
               !spectrum_due_ && fits_share_.left() &&
               sampler_.until_next_us(now_us) > (longest_slice_us_ < most_us ? longest_slice_us_ : most_us);
    }

    // Advances the estimator of one axis by one sample, if there is time. Returns whether there was time.
    bool estimate(uint32_t now_us) {
        if (!settings::kEstimate || !may_estimate(now_us)) return false;
        const bool started = estimation_.started();
        estimate_due_ = estimation_.work(estimate_);
        const uint32_t took_us = clock_.now_us() - now_us;
        if (took_us > longest_axis_us_) longest_axis_us_ = took_us;
        if (estimation_.started() && !started) estimator_due_ = true;
        return true;
    }

    // Does a slice of a fit, if there is time. Returns whether there was time.
    bool fit(uint32_t now_us) {
        if (!settings::kFit) return false;
        fits_share_.pass(now_us);
        if (!may_fit(now_us)) return false;
        const NoiseFit::Told told = estimation_.noise().work(fit_, spectrum_);
        fit_due_ = told == NoiseFit::Told::fit;
        if (settings::kTuned && fit_due_ && estimation_.retune(fit_)) fit_.flags |= fit_flags::tuned;
        spectrum_due_ = told == NoiseFit::Told::spectrum;
        const uint32_t took_us = clock_.now_us() - now_us;
        if (took_us > longest_slice_us_) longest_slice_us_ = took_us;
        fits_share_.spend(took_us);
        return true;
    }

    void report(uint32_t now_us) {
        const bool hello_due = hello_.due(now_us);
        if ((hello_due || announced_starts_ != health_.sensor_starts()) && link_.send(hello(), now_us)) {
            hello_.done();
            announced_starts_ = health_.sensor_starts();
            estimator_due_ = settings::kEstimate;
        }
        faults_.send(link_, now_us);
        if (status_.due(now_us) && link_.send(status(now_us), now_us)) {
            status_.done();
            workload_.begin(now_us);
        }
        const uint32_t quiet_us = sampler_.until_next_us(now_us) + kReadUs;
        if (estimator_due_ && link_.send(estimator(), now_us, quiet_us)) estimator_due_ = false;
        if (estimate_due_ && link_.send(estimate_, now_us, quiet_us)) estimate_due_ = false;
        if (fit_due_ && link_.send(fit_, now_us, quiet_us)) fit_due_ = false;
        // At most one SPECTRUM is sent per sampling period, because the serial port has to be free again when
        // the next sample comes.
        const uint16_t instant = sampler_.sequence();
        if (spectrum_due_ && instant != spectrum_at_ && link_.send(spectrum_, now_us, quiet_us)) {
            spectrum_due_ = false;
            spectrum_at_ = instant;
        }
    }

    Hello hello() const {
        Hello hello = {};
        hello.protocol_major = kProtocolMajor;
        hello.protocol_minor = kProtocolMinor;
        hello.schema_hash = kSchemaHash;
        hello.boot_id = identity_.boot_id;
        memcpy(hello.device_id, identity_.device_id, sizeof hello.device_id);
        write_version(hello.firmware_version);
        hello.who_am_i = health_.who_am_i();
        hello.sensor_starts = health_.sensor_starts();
        hello.sample_rate = 1000000000 / settings::kSamplePeriodUs;
        hello.gyro_range = settings::kGyroRangeDps;
        hello.gyro_lsb = kGyroLsbTenths;
        hello.accel_range = settings::kAccelRangeG;
        hello.accel_lsb = kAccelLsb;
        hello.gyro_dlpf = gyro_dlpf_hz(health_.who_am_i());
        hello.sampling_mode = mode_;
        return hello;
    }

    Estimator estimator() const {
        Estimator message;
        estimation_.report(message);
        message.longest_axis = longest_axis_us_;
        message.longest_slice = longest_slice_us_;
        return message;
    }

    Status status(uint32_t now_us) const {
        Status status = {};
        status.i2c_errors = health_.i2c_errors();
        status.bus_recoveries = health_.bus_recoveries();
        status.sensor_reinits = health_.sensor_reinits();
        status.overruns = sampler_.overruns();
        status.dropped_frames = link_.dropped_frames();
        status.reset_cause = identity_.reset_cause;
        status.cpu_share = workload_.share(now_us);
        status.longest_step = workload_.longest_us();
        return status;
    }

    // Writes the text "VERSION PORT BUILD" for HELLO. Characters that do not fit are omitted.
    template <size_t N>
    void write_version(char (&text)[N]) const {
        size_t n = 0;
        const char* const parts[] = {kVersion, " ", identity_.port, " ", kBuildId};
        for (const char* part : parts) {
            while (*part != 0 && n < N) text[n++] = *part++;
        }
    }

    Clock& clock_;
    const Identity identity_;
    const SamplingMode mode_;
    Faults faults_;
    Link link_;
    Health health_;
    Sampler sampler_;
    EverySecond hello_;
    EverySecond status_;
    Estimation estimation_;
    Estimate estimate_ = {};  // the ESTIMATE that waits to be sent, if estimate_due_ is true
    Fit fit_ = {};            // the FIT that waits to be sent, if fit_due_ is true
    Spectrum spectrum_ = {};  // the SPECTRUM that waits to be sent, if spectrum_due_ is true
    Allowance<settings::kFitShare> fits_share_;
    Workload workload_;
    uint32_t longest_axis_us_ = 0;
    uint32_t longest_slice_us_ = 0;
    uint16_t announced_starts_ = 0;
    bool estimate_due_ = false;
    bool estimator_due_ = false;
    uint16_t spectrum_at_ = 0;  // sequence number of the sample after which the last SPECTRUM was sent
    bool fit_due_ = false;
    bool spectrum_due_ = false;
};

}  // namespace fltea
