// When to sample, and the number of each instant. Instants pass whether a sample is read or not, so that
// delivered + lost = due.
#pragma once

#include <stdint.h>

#include "edges.h"
#include "messages.h"
#include "settings.h"

namespace fltea {

class Sampler {
  public:
    explicit Sampler(SamplingMode mode) : by_edges_(mode == SamplingMode::data_ready) {}

    // At boot. Due times of the timer mode are the multiples of the period from here on; they go on without a
    // sensor, because after a wrap of the clock multiples would be at another phase of the board's timer.
    void begin(uint32_t now_us) { next_due_us_ = (now_us / kPeriodUs + 1) * kPeriodUs; }

    // The sensor runs from now on. Numbering begins when it first does; after that, instants have gone on.
    void sensor_runs(uint32_t now_us) {
        edges_taken_ = edges_.seen().count;
        last_edge_us_ = now_us;
        if (!numbering_) accounted_us_ = now_us;
        numbering_ = true;
        running_ = true;
    }

    void sensor_stops() { running_ = false; }

    // From the interrupt handler.
    void on_data_ready(uint32_t now_us) { edges_.add(now_us); }

    // True if instants came since the last call and the newest awaits its sample: read it, or call missed().
    // The others are overruns by now.
    bool poll(uint32_t now_us) {
        if (!by_edges_) return poll_timer(now_us);
        if (running_) return poll_edges();
        if (numbering_) pass_by_time(now_us);
        return false;
    }

    // The instant that poll() announced passed without a sample.
    void missed() { ++overruns_; }

    // A burst began at `burst_us`: if instants came between poll() and then, because a first try took long,
    // the sample is the newest one's and the one announced is an overrun.
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

    // The instant that awaits its sample, and its number.
    uint32_t due_us() const { return due_us_; }
    uint16_t sequence() const { return static_cast<uint16_t>(instants_ - 1); }
    uint32_t instant() const { return instants_ - 1; }

    // Until the next instant is expected [us]; 0 if it is late.
    uint32_t until_next_us(uint32_t now_us) const {
        const uint32_t next_us = by_edges_ ? last_edge_us_ + kPeriodUs : next_due_us_;
        return is_before(now_us, next_us) ? next_us - now_us : 0;
    }

    // Since the last edge, or since the sensor runs if none came [us]; 0 in timer mode.
    uint32_t silence_us(uint32_t now_us) const { return by_edges_ && running_ ? now_us - last_edge_us_ : 0; }

    // Instants that passed without a sample.
    uint32_t overruns() const { return overruns_; }

  private:
    static constexpr uint32_t kPeriodUs = settings::kSamplePeriodUs;

    // Right over the wrap of the clock for instants less than 35 minutes apart.
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

    // An edge that got lost shows as time.
    void take(const Edges::Seen& seen) {
        const uint32_t came = seen.count - edges_taken_;
        const uint32_t by_time = (seen.last_us - accounted_us_ + kPeriodUs / 2) / kPeriodUs;
        edges_taken_ = seen.count;
        due_us_ = last_edge_us_ = accounted_us_ = seen.last_us;
        pass(came > by_time ? came : by_time);
    }

    // Without edges, half a period behind, so that the first edge to come is one instant by time as well.
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
    uint32_t accounted_us_ = 0;  // up to where edges or time have been made into instants
    uint32_t next_due_us_ = 0;
    uint32_t due_us_ = 0;
    uint32_t instants_ = 0;
    uint32_t overruns_ = 0;
};

}  // namespace fltea
