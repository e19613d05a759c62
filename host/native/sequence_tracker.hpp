// Computes for each sample its sequence number and its device time within the epoch (a run of samples without
// a restart or a long gap), without the wraps of the wire protocol, and the number of samples that are
// missing before it. The rules are those of protocol/README.md. The field `sequence` of SAMPLE numbers the
// sampling instants. Within a boot, the numbers of delivered and of lost samples therefore add up to the
// number of sampling instants, even where the sensor was set up again.
//
// If sequence and device time of a sample disagree, the device was restarted or exchanged, and samples are
// ignored until its next HELLO. If the samples then go on to show another rate than the HELLO states, the
// device's clock or the HELLO is wrong. Samples are then ignored until their times agree with the stated
// rate.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "rate_watch.hpp"

namespace fltea {

// Why a new epoch (a run of samples without a restart or a long gap) begins with a sample; kNone: none
// begins. kEpochReasons has the names of the reasons, as in the record `epoch`.
enum class EpochReason : int { kNone, kStart, kRestart, kSensorRestart, kDiscontinuity, kGap, kSilence };
constexpr const char* kEpochReasons[] = {"",    "start",  "restart", "sensor_restart", "discontinuity",
                                         "gap", "silence"};

struct PlaceCounts {
    std::int64_t delivered, lost, gaps, duplicates, before_hello, rate_differs;

    // Calls `each` with the name and the value of every count. The names are those of SampleStats in Python.
    template <typename Each>
    void visit(Each each) const {
        each("delivered", delivered);
        each("lost", lost);
        each("gaps", gaps);
        each("duplicates", duplicates);
        each("before_hello", before_hello);
        each("rate_differs", rate_differs);
    }
};

// The newest sample. `sequence` and `device_us` are as received, and begin again from 0 when they wrap. `seq`
// and `epoch_us` are the same figures, but they go on rising within the epoch.
struct Newest {
    std::int64_t sequence, device_us, host_ns, seq, epoch_us;
};

// Says how a sample continues the stream after the previous sample.
struct Judged {
    enum Kind { kTaken, kDuplicate, kUnusable };
    Kind kind;
    EpochReason reason;  // why an epoch begins with this sample, or kNone
    // number of samples that are missing just before this sample; the missing ones have the numbers seq -
    // missing to seq - 1
    std::int64_t missing;
    std::int64_t seq, epoch_us;
};

class SequenceTracker {
  public:
    // After half an hour without a sample, it is unknown how often the device time has wrapped; it wraps
    // every 71.6 minutes.
    static constexpr std::int64_t kMaxSilenceNs = std::int64_t(30) * 60 * 1'000'000'000;
    // A gap is accepted only if its lengths by device time and by host time differ by at most this. After a
    // reset of the device, sequence and device time can look as if there was a gap of up to 71 minutes. The
    // host's clock shows that there was no such gap, even if samples arrive late.
    static constexpr std::int64_t kMaxHostDisagreementUs = std::int64_t(5) * 60 * 1'000'000;
    // The length of a gap follows from the sequence numbers, and also from the device time. The two lengths
    // may differ by this fraction of the length, plus one period. The clock of a sensor is accurate to 1 %;
    // this is twice as much.
    static constexpr double kClockTolerance = 0.02;
    static constexpr std::int64_t kSequenceWrap = 1 << 16, kTimeWrapUs = std::int64_t(1) << 32;

    // Notes a received HELLO. `longest_gap`: largest number of consecutive samples that may be missing within
    // an epoch.
    void on_hello(double rate_hz, std::int64_t longest_gap, bool is_another_boot, bool is_another_sensor) {
        if (is_another_boot && has_boot_) {
            pending_ = EpochReason::kRestart;
        } else if (is_another_sensor && pending_ == EpochReason::kNone) {
            pending_ = EpochReason::kSensorRestart;
        }
        const bool is_another_rate = period_us_ != 1e6 / rate_hz;
        has_boot_ = knows_hello_ = true;
        period_us_ = 1e6 / rate_hz;
        if (is_another_boot || is_another_sensor || is_another_rate) {
            seen_ = {};
            accept_again();
        }
        longest_gap_ = longest_gap;
    }

    // Ignores all samples until the next HELLO, because they may come from another device.
    void forget_hello() {
        knows_hello_ = disagreed_ = false;
        seen_ = {};
        accept_again();
    }
    bool knows_hello() const { return knows_hello_; }

    // Begins a new epoch with the next sample. Call this where a recording states that an epoch began.
    void on_break(EpochReason reason) {
        if (pending_ == EpochReason::kNone || pending_ == EpochReason::kSensorRestart) pending_ = reason;
    }

    // Whether a sample directly follows the newest sample. The sample's number, the device's clock and the
    // host's clock must all say so. Most samples follow directly.
    bool follows(std::int64_t sequence, std::int64_t device_us, std::int64_t host_ns) const {
        const std::int64_t step_us = time_step_us(device_us), step_ns = host_ns - newest_.host_ns;
        return sequence_step(sequence) == 1 &&
               std::fabs(double(step_us) - period_us_) <= (kClockTolerance + 1) * period_us_ &&
               std::llabs(step_us * 1000 - step_ns) <= kMaxHostDisagreementUs * 1000 &&
               step_ns <= kMaxSilenceNs;
    }

    // Judges a sample. Call this only if a HELLO is known. A sample that cannot be used is counted here, so
    // that the caller need not do anything about it.
    Judged judge(std::int64_t sequence, std::int64_t device_us, std::int64_t host_ns) {
        const bool must_begin =
            !any_ || !(pending_ == EpochReason::kNone || pending_ == EpochReason::kSensorRestart);
        if (must_begin) {
            return begins(sequence, device_us,
                          pending_ == EpochReason::kNone ? EpochReason::kStart : pending_);
        }
        if (host_ns - newest_.host_ns > kMaxSilenceNs) {
            return begins(sequence, device_us,
                          pending_ == EpochReason::kNone ? EpochReason::kSilence : pending_);
        }
        const std::int64_t step_us = time_step_us(device_us);
        if (pending_ == EpochReason::kNone && follows(sequence, device_us, host_ns)) {
            return {Judged::kTaken, EpochReason::kNone, 0, newest_.seq + 1, newest_.epoch_us + step_us};
        }
        const std::int64_t step_of_sequence = sequence_step(sequence);
        if (step_of_sequence == 0 && step_us == 0) {
            ++counts_.duplicates;
            return {Judged::kDuplicate, EpochReason::kNone, 0, 0, 0};
        }
        const double wraps =
            std::nearbyint((double(step_us) / period_us_ - double(step_of_sequence)) / double(kSequenceWrap));
        const std::int64_t step = step_of_sequence + std::int64_t(wraps) * kSequenceWrap;
        const double disagreement_us = std::fabs(double(step_us) - double(step) * period_us_);
        const double host_step_us = double(host_ns - newest_.host_ns) / 1000;
        if (step < 1 || disagreement_us > kClockTolerance * double(step) * period_us_ + period_us_ ||
            std::fabs(double(step_us) - host_step_us) > double(kMaxHostDisagreementUs)) {
            pending_ = EpochReason::kDiscontinuity;
            knows_hello_ = false;
            disagreed_ = true;
            note_before_hello(sequence, device_us);
            return {Judged::kUnusable, EpochReason::kNone, 0, 0, 0};
        }
        const std::int64_t missing = step - 1;
        note_lost(missing);
        EpochReason reason = pending_;
        if (reason == EpochReason::kNone && missing > longest_gap_) reason = EpochReason::kGap;
        return {Judged::kTaken, reason, missing, newest_.seq + step, newest_.epoch_us + step_us};
    }

    // Accepts the next sample. Call this only if follows() is true for it.
    void go_on(std::int64_t sequence, std::int64_t device_us, std::int64_t host_ns) {
        newest_.epoch_us += time_step_us(device_us);
        ++newest_.seq;
        come_to(sequence, device_us, host_ns);
    }

    // Accepts a sample for which judge() has returned `judged`.
    void take(const Judged& judged, std::int64_t sequence, std::int64_t device_us, std::int64_t host_ns) {
        newest_.seq = judged.seq;
        newest_.epoch_us = judged.epoch_us;
        pending_ = EpochReason::kNone;
        any_ = true;
        come_to(sequence, device_us, host_ns);
    }

    void note_lost(std::int64_t count) {
        counts_.lost += count;
        counts_.gaps += count > 0;
    }
    // Counts a sample that is rejected because the next HELLO has not come yet. If the HELLO is awaited
    // because number and time of an earlier sample disagreed, the rate of the rejected samples is checked,
    // too (RateWatch). If this rate differs from the stated one, and the HELLO then shows the same device and
    // rate as before, rate_differs() becomes true.
    void note_before_hello(std::int64_t sequence, std::int64_t device_us) {
        ++counts_.before_hello;
        if (disagreed_) watch(sequence, device_us);
    }

    // Whether the device's clock contradicts the rate in its HELLO, so that all samples are rejected.
    // note_rate_differs() counts a rejected sample.
    bool rate_differs() const { return rate_differs_; }
    void note_rate_differs(std::int64_t sequence, std::int64_t device_us) {
        ++counts_.rate_differs;
        if (watch(sequence, device_us) == RateWatch::kAgrees) accept_again();
    }
    // Whether samples have shown that the device's clock contradicts its HELLO, and the caller was not
    // notified of it yet. stated_hz() is the rate in HELLO, and measured_hz() is the rate by the device's
    // clock.
    bool has_news() const { return has_news_; }
    void told_news() { has_news_ = false; }
    double stated_hz() const { return 1e6 / period_us_; }
    double measured_hz() const { return watch_.rate_hz(); }

    // Whether the next sample may directly follow the newest one, because no new epoch has to begin and a
    // HELLO is known.
    bool goes_on() const { return any_ && knows_hello_ && pending_ == EpochReason::kNone; }
    const Newest& newest() const { return newest_; }
    const PlaceCounts& counts() const { return counts_; }

  private:
    static Judged begins(std::int64_t sequence, std::int64_t device_us, EpochReason reason) {
        return {Judged::kTaken, reason, 0, sequence, device_us};
    }
    std::int64_t sequence_step(std::int64_t sequence) const {
        return (sequence - newest_.sequence) & (kSequenceWrap - 1);
    }
    std::int64_t time_step_us(std::int64_t device_us) const {
        return (device_us - newest_.device_us) & (kTimeWrapUs - 1);
    }
    void come_to(std::int64_t sequence, std::int64_t device_us, std::int64_t host_ns) {
        newest_.sequence = sequence;
        newest_.device_us = device_us;
        newest_.host_ns = host_ns;
        ++counts_.delivered;
        watch(sequence, device_us);
    }

    // Checks the rate of all samples since a HELLO, whether they were accepted or not. While the next HELLO
    // is awaited, the samples may come from another device. A wrong rate is then not reported yet.
    RateWatch::Verdict watch(std::int64_t sequence, std::int64_t device_us) {
        if (!seen_.any) watch_.begin();
        const std::int64_t step = (sequence - seen_.sequence) & (kSequenceWrap - 1);
        const std::int64_t step_us = (device_us - seen_.device_us) & (kTimeWrapUs - 1);
        const RateWatch::Verdict found = watch_.add(step, step_us, period_us_);
        const RateWatch::Verdict known = found == RateWatch::kUnknown ? seen_.verdict : found;
        seen_ = {true, sequence, device_us, known};
        if (known == RateWatch::kDiffers && knows_hello_ && !rate_differs_) rate_differs_ = has_news_ = true;
        return found;
    }

    // Accepts samples again. If samples were rejected because of their rate, a new epoch begins. Within the
    // old epoch, the rejected samples would count as lost, although they are counted separately.
    void accept_again() {
        if (rate_differs_ && pending_ == EpochReason::kNone) pending_ = EpochReason::kDiscontinuity;
        rate_differs_ = has_news_ = false;
    }

    struct Seen {
        bool any;
        std::int64_t sequence, device_us;
        RateWatch::Verdict verdict;  // last verdict of the check of the rate (RateWatch)
    };

    Newest newest_ = {};
    PlaceCounts counts_ = {};
    EpochReason pending_ = EpochReason::kStart;
    double period_us_ = 0;
    std::int64_t longest_gap_ = 0;
    bool any_ = false, has_boot_ = false, knows_hello_ = false;
    RateWatch watch_;
    Seen seen_ = {};
    // whether number and time of a sample have disagreed, and no HELLO has come since then
    bool disagreed_ = false;
    bool rate_differs_ = false, has_news_ = false;
};

inline EpochReason epoch_reason_of(const char* name) {
    for (int i = 1; i < int(sizeof kEpochReasons / sizeof *kEpochReasons); ++i) {
        if (std::strcmp(kEpochReasons[i], name) == 0) return static_cast<EpochReason>(i);
    }
    return EpochReason::kNone;
}

}  // namespace fltea
