// Decides when to sample, and numbers the sampling instants. Every instant is counted, whether a sample is
// read at it or not. The number of instants is therefore that of samples delivered plus that of samples lost.
#pragma once

#include <stdint.h>

#include "edges.h"
#include "messages.h"
#include "settings.h"

namespace fltea {

class Sampler {
  public:
    explicit Sampler(SamplingMode mode) : by_edges_(mode == SamplingMode::data_ready) {}

    // Call this at boot. In timer mode, a sampling instant is due at each multiple of the period from now on,
    // also without a sensor. Do not call this again: after a wrap of the 32-bit clock, multiples of the
    // period are other times, at which the board's timer gives no interrupt.
    void begin(uint32_t now_us) { next_due_us_ = (now_us / kPeriodUs + 1) * kPeriodUs; }

    // Call this when the sensor begins to run. The numbering of the instants begins when the sensor runs for
    // the first time. From then on, instants are counted also while the sensor does not run.
    void sensor_runs(uint32_t now_us) {
        edges_taken_ = edges_.seen().count;
        last_edge_us_ = now_us;
        if (!numbering_) accounted_us_ = now_us;
        numbering_ = true;
        running_ = true;
    }

    void sensor_stops() { running_ = false; }

    // Call this from the interrupt handler of the data-ready pin.
    void on_data_ready(uint32_t now_us) { edges_.add(now_us); }

    // Returns true if sampling instants have passed since the last call and the newest of them needs its
    // sample. The caller then reads the sample, or calls missed(). The instants before the newest one count
    // as overruns.
    bool poll(uint32_t now_us) {
        if (!by_edges_) return poll_timer(now_us);
        if (running_) return poll_edges();
        if (numbering_) pass_by_time(now_us);
        return false;
    }

    // Call this if the instant that poll() announced gets no sample.
    void missed() { ++overruns_; }

    // Call this with the time `burst_us` at which the reading of a sample began. If a first attempt to read
    // took long, further instants may have passed since poll(). The sample then belongs to the newest
    // instant, and the instant that poll() announced counts as an overrun.
    void burst_began(uint32_t burst_us) {
        if (!by_edges_) {
            if (poll_timer(burst_us)) missed();
            return;
        }
        const Edges::Seen seen = edges_.seen();
        if (seen.count == edges_taken_ || is_before(burst_us, seen.last_us)) return;
        missed();
        take(seen);
    }

    // The sampling instant that poll() announced: its time, its number in 16 bits, its number in 32 bits.
    uint32_t due_us() const { return due_us_; }
    uint16_t sequence() const { return static_cast<uint16_t>(instants_ - 1); }
    uint32_t instant() const { return instants_ - 1; }

    // Returns the time until the next expected instant [us], or 0 if that instant is late.
    uint32_t until_next_us(uint32_t now_us) const {
        const uint32_t next_us = by_edges_ ? last_edge_us_ + kPeriodUs : next_due_us_;
        return is_before(now_us, next_us) ? next_us - now_us : 0;
    }

    // Returns the time since the last edge of the data-ready pin [us], or since the sensor began to run if no
    // edge has come. Returns 0 in timer mode.
    uint32_t silence_us(uint32_t now_us) const { return by_edges_ && running_ ? now_us - last_edge_us_ : 0; }

    // Returns the number of instants without a sample.
    uint32_t overruns() const { return overruns_; }

  private:
    static constexpr uint32_t kPeriodUs = settings::kSamplePeriodUs;

    // Whether the time a is before the time b. This is correct across a wrap of the clock, for times less
    // than 35 minutes apart.
    static bool is_before(uint32_t a_us, uint32_t b_us) { return b_us - a_us - 1 < UINT32_C(0x7FFFFFFF); }

    bool poll_timer(uint32_t now_us) {
        if (is_before(now_us, next_due_us_)) return false;
        const uint32_t passed = (now_us - next_due_us_) / kPeriodUs + 1;
        next_due_us_ += passed * kPeriodUs;
        due_us_ = next_due_us_ - kPeriodUs;
        if (numbering_) pass(passed);
        return numbering_;
    }

    bool poll_edges() {
        const Edges::Seen seen = edges_.seen();
        if (seen.count == edges_taken_) return false;
        take(seen);
        return true;
    }

    // Counts the sampling instants since the last call, both by the edges and by the elapsed time, and uses
    // the larger number. If an edge was lost, that is the number by the elapsed time.
    void take(const Edges::Seen& seen) {
        const uint32_t came = seen.count - edges_taken_;
        const uint32_t by_time = (seen.last_us - accounted_us_ + kPeriodUs / 2) / kPeriodUs;
        edges_taken_ = seen.count;
        due_us_ = last_edge_us_ = accounted_us_ = seen.last_us;
        pass(came > by_time ? came : by_time);
    }

    // Counts sampling instants by the elapsed time while the sensor does not run and so gives no edges. Each
    // instant is counted half a period after it was due. So if an edge comes at an instant, this instant is
    // not counted yet, but all before it are: the edge counts as exactly one instant.
    void pass_by_time(uint32_t now_us) {
        const uint32_t elapsed_us = now_us - accounted_us_;
        if (elapsed_us < kPeriodUs + kPeriodUs / 2) return;
        const uint32_t passed = (elapsed_us - kPeriodUs / 2) / kPeriodUs;
        accounted_us_ += passed * kPeriodUs;
        instants_ += passed;
        overruns_ += passed;
    }

    void pass(uint32_t passed) {
        instants_ += passed;
        overruns_ += passed - 1;
    }

    const bool by_edges_;
    bool running_ = false;
    bool numbering_ = false;
    Edges edges_;
    uint32_t edges_taken_ = 0;
    uint32_t last_edge_us_ = 0;
    uint32_t accounted_us_ = 0;  // instants were counted up to this time
    uint32_t next_due_us_ = 0;
    uint32_t due_us_ = 0;
    uint32_t instants_ = 0;
    uint32_t overruns_ = 0;
};

}  // namespace fltea
