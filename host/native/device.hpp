// Processes the samples of one device: computes their sequence numbers and times, converts them to physical
// units, and passes them to the device's sensors. All samples, live or recorded, pass through this class
// (host/README.md, "The way of a sample").
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

#include "sample_columns.hpp"
#include "sensor.hpp"
#include "sequence_tracker.hpp"
#include "timebase.hpp"

namespace fltea {

// Why `advance` returned. The caller handles the reason, then calls `advance` again.
enum class Stop : int {
    kEnd,       // all samples have been processed
    kMore,      // nothing has happened that the caller must handle, but more samples wait
    kStatsDue,  // before a sample: this sample arrived at or after the time at which statistics are due
    // before a sample: samples just before it are missing; the filters have bridged the gap by prediction
    kGap,
    // before a sample: an epoch (a run of samples without a restart or a long gap) begins with it; call
    // begin()
    kEpoch,
    kHappened,     // after a sample: a bias stepped, motion began or ended, or an axis was lost
    kWindowFull,   // after a sample: the start-up window of a sensor is full
    kFitCounts,    // after a sample: the result of a finished fit takes effect at the next sample
    kFitDue,       // after a sample: a fit has to begin
    kRateDiffers,  // after a sample: the device's clock contradicts the rate that its HELLO states
};

// Whether `advance` makes this stop before it processes the sample that caused the stop, rather than after
// it.
constexpr bool stands_before_sample(Stop stop) {
    return stop == Stop::kStatsDue || stop == Stop::kGap || stop == Stop::kEpoch;
}

// Something that happened at a sample. If `is_lost` is true, an axis became invalid, and `lost` says which
// and why. Otherwise `event` says what the tracker noticed.
struct Happening {
    std::size_t row;  // index of the sample in the run of samples
    std::size_t sensor;
    bool is_lost;
    Lost lost;
    track::TrackerEvent event;
};

// Columns of a run, which is a series of consecutive samples that are processed together. A column has the
// shape (n,) or (n, width) for n samples.
struct RunColumns {
    std::size_t n = 0, first = 0;  // number of rows of the run; index of its first sample in the source
    std::int64_t *seq = nullptr, *device_us = nullptr, *host_ns = nullptr, *flags = nullptr;
    double *gyro_dps = nullptr, *accel_ms2 = nullptr, *temperature_c = nullptr;
    std::size_t gyro_width = 0, accel_width = 0;
    std::vector<SensorColumns> sensors;
};

// Number of a sample, its device time in the epoch [us] and its Unix time [ns].
struct Moment {
    std::int64_t seq, device_us, host_ns;
};

struct Advanced {
    Stop stop;
    std::size_t next;  // index of the next sample in the source
    // range of rows of the run, from `begin` to before `end`, that have to be published before the events are
    // handled
    std::size_t begin, end;
};

class Device {
  public:
    static constexpr std::int64_t kNever = std::int64_t(1) << 62;

    SequenceTracker place;
    Timebase timebase;
    Scales scales = {};
    std::vector<Sensor> sensors;
    std::int64_t stats_due_ns = kNever;
    // Numbers of the samples at which `advance` stops because a fit has to begin, or because the result of a
    // fit takes effect. Each number causes one stop, and then has to be set again.
    std::int64_t fit_due = kNever, fit_counts = kNever;

    // Begins an epoch with the sample at which `advance` has stopped.
    void begin(std::int64_t offset_ns, std::vector<Sensor> of_epoch) {
        timebase = Timebase(offset_ns);
        sensors = std::move(of_epoch);
        fit_due = fit_counts = kNever;
        is_ready_ = true;
        is_new_ = true;
    }

    const RunColumns& run() const { return run_; }
    // Sample number and times of the last sample that was returned, if there is one.
    bool has_moment() const { return has_moment_; }
    const Moment& moment() const { return moment_; }
    const std::vector<Happening>& happened() const { return happened_; }
    // How the sample at which `advance` has stopped continues the stream (sequence_tracker.hpp), after a stop
    // with kGap or kEpoch. After kGap, judged_ns() is the Unix time of that sample.
    const Judged& judged() const { return judged_; }
    std::int64_t judged_ns() const { return judged_ns_; }
    // After a stop with kGap: for each sensor, the axes that became invalid while samples were missing.
    const std::vector<std::vector<Lost>>& lost_meanwhile() const { return lost_; }

    // Processes samples from index `at` on, up to the first sample at which the caller has to do something.
    // The function `room(bytes)` has to return memory for the columns of a run (RunColumns), which stays
    // valid until `advance` has returned all rows of the run. Throws std::domain_error for values that no
    // filter can process.
    template <typename Room>
    Advanced advance(const SampleColumns& from, std::size_t at, Room room) {
        happened_.clear();
        if (given_ < run_.n) return more_of_run(from, at);
        if (const Stop after = due_after(); after != Stop::kEnd) return {after, at, 0, 0};
        while (at < from.n) {
            if (from.host_ns[at] >= stats_due_ns) return {Stop::kStatsDue, at, 0, 0};
            if (place.rate_differs() || !place.knows_hello()) {
                if (place.rate_differs()) {
                    place.note_rate_differs(from.sequence[at], from.device_us[at]);
                } else {
                    place.note_before_hello(from.sequence[at], from.device_us[at]);
                }
                ++at;
                continue;
            }
            const bool goes_on = !is_judged_ && place.goes_on() &&
                                 place.follows(from.sequence[at], from.device_us[at], from.host_ns[at]);
            if (!goes_on) {
                const Stop before = judge(from, at);
                if (before != Stop::kEnd) return {before, at, 0, 0};
                if (judged_.kind != Judged::kTaken) {
                    ++at;
                    continue;
                }
            }
            take(from, at, goes_on, room);
            return more_of_run(from, at + run_.n);
        }
        return {Stop::kEnd, at, 0, 0};
    }

  private:
    // Largest number of rows in a run. The number is small, so that the columns that one step of the
    // processing writes are still in the cache for the next step.
    static constexpr std::size_t kMostRows = 2048;

    // Decides how the next sample continues the stream (judged_). If `advance` has to return before this
    // sample, returns the reason. Otherwise returns kEnd: the sample is ignored, or has to be processed now.
    Stop judge(const SampleColumns& from, std::size_t at) {
        if (!is_judged_) {
            judged_ = place.judge(from.sequence[at], from.device_us[at], from.host_ns[at]);
            if (judged_.kind != Judged::kTaken) return Stop::kEnd;
            is_judged_ = true;
            is_ready_ = false;
            judged_ns_ = kNever;
        }
        if (is_ready_) return Stop::kEnd;
        if (judged_.reason != EpochReason::kNone) return Stop::kEpoch;
        is_ready_ = true;
        judged_ns_ = timebase.add(judged_.seq, judged_.epoch_us, from.host_ns[at]);
        if (judged_.missing == 0) return Stop::kEnd;
        lost_.assign(sensors.size(), {});
        for (std::size_t k = 0; k < sensors.size(); ++k)
            sensors[k].skip(static_cast<std::uint64_t>(judged_.missing), lost_[k]);
        return Stop::kGap;
    }

    Stop due_after() {
        if (window_is_full_) {
            window_is_full_ = false;
            return Stop::kWindowFull;
        }
        if (place.has_news()) {
            place.told_news();
            return Stop::kRateDiffers;
        }
        // Before the first sample of an epoch is processed, newest() is still the last sample of the previous
        // epoch. Its number must not be compared with fit_counts and fit_due, which may already be those of
        // the new epoch.
        if (is_new_) return Stop::kEnd;
        const std::int64_t seq = place.newest().seq;
        if (seq >= fit_counts) {
            fit_counts = kNever;
            return Stop::kFitCounts;
        }
        if (seq >= fit_due) {
            fit_due = kNever;
            return Stop::kFitDue;
        }
        return Stop::kEnd;
    }

    // Returns the next rows of the present run of samples, up to that of the next event or else to the end.
    Advanced more_of_run(const SampleColumns& from, std::size_t next) {
        const std::size_t begin = given_;
        std::size_t end = run_.n;
        if (told_ < pending_.size()) end = pending_[told_].row + 1;
        while (told_ < pending_.size() && pending_[told_].row + 1 == end)
            happened_.push_back(pending_[told_++]);
        given_ = end;
        moment_ = {run_.seq[end - 1], run_.device_us[end - 1], run_.host_ns[end - 1]};
        has_moment_ = true;
        Stop stop = Stop::kMore;
        if (!happened_.empty()) stop = Stop::kHappened;
        const std::int64_t seq = place.newest().seq;
        const bool is_over = given_ == run_.n && next == from.n && !window_is_full_ && !place.has_news() &&
                             seq < fit_counts && seq < fit_due;
        return {stop == Stop::kMore && is_over ? Stop::kEnd : stop, next, begin, end};
    }

    template <typename Room>
    void take(const SampleColumns& from, std::size_t at, bool goes_on, Room room) {
        place_rows(from, at, goes_on);
        is_new_ = false;
        run_.n = seq_.size();
        run_.first = at;
        given_ = told_ = 0;
        pending_.clear();
        lay_out(from, room);
        scale(from, at);
        const double* const accel = run_.accel_ms2;
        values_.resize(sensors.size());
        for (std::size_t k = 0; k < sensors.size(); ++k) {
            const bool is_accel = sensors[k].is_accel;
            const double* const values = is_accel ? accel : run_.gyro_dps;
            const std::size_t width = is_accel ? run_.accel_width : run_.gyro_width;
            if (has_values(k) && !sensors[k].choose(values, run_.n, width, values_[k]))
                throw std::domain_error(
                    "samples have to be finite, and as many axes as their epoch began with");
        }
        for (std::size_t k = 0; k < sensors.size(); ++k) {
            if (has_values(k)) run_sensor(k, accel);
        }
        std::stable_sort(pending_.begin(), pending_.end(), [](const Happening& a, const Happening& b) {
            return a.row != b.row ? a.row < b.row : a.is_lost > b.is_lost;
        });
    }

    // A source may have no accelerometer columns.
    bool has_values(std::size_t k) const { return !sensors[k].is_accel || run_.accel_ms2 != nullptr; }

    void run_sensor(std::size_t k, const double* accel) {
        Sensor& one = sensors[k];
        std::vector<track::TrackerEvent> events;
        std::vector<Lost> lost;
        const std::size_t left = one.window_left;
        // Motion of the gyroscope is detected by the accelerometer, too. Motion of the accelerometer is
        // detected by its own axes alone.
        one.run(values_[k], one.is_accel ? nullptr : accel, accel == nullptr ? 0 : run_.accel_width, run_.n,
                run_.sensors[k], events, lost);
        window_is_full_ |= left > 0 && one.window_left == 0;
        for (const Lost& each : lost) pending_.push_back({each.row, k, true, each, {}});
        for (const track::TrackerEvent& each : events) pending_.push_back({each.row, k, false, {}, each});
    }

    // Computes the sequence numbers and times of the samples of a run, one row each.
    void place_rows(const SampleColumns& from, std::size_t at, bool goes_on) {
        seq_.clear();
        device_us_.clear();
        host_ns_.clear();
        std::size_t most = std::min(from.n - at, kMostRows);
        for (const Sensor& one : sensors) {
            if (one.window_left > 0) most = std::min(most, one.window_left);
        }
        for (std::size_t i = at; i < at + most; ++i) {
            const std::int64_t sequence = from.sequence[i], us = from.device_us[i], ns = from.host_ns[i];
            if (i > at && (ns >= stats_due_ns || !place.follows(sequence, us, ns))) break;
            const bool was_judged = i == at && !goes_on;
            if (was_judged) {
                place.take(judged_, sequence, us, ns);
                is_judged_ = is_ready_ = false;
            } else {
                place.go_on(sequence, us, ns);
            }
            const Newest& now = place.newest();
            const bool is_timed = was_judged && judged_ns_ != kNever;
            seq_.push_back(now.seq);
            device_us_.push_back(now.epoch_us);
            host_ns_.push_back(is_timed ? judged_ns_ : timebase.add(now.seq, now.epoch_us, ns));
            if (now.seq >= fit_counts || now.seq >= fit_due || place.rate_differs()) break;
        }
    }

    template <typename Room>
    void lay_out(const SampleColumns& from, Room room) {
        const std::size_t n = run_.n;
        run_.gyro_width = from.gyro.width();
        const bool has_accel = from.accel && scales.has_accel;
        run_.accel_width = has_accel ? from.accel.width() : 0;
        std::size_t numbers = n * (3 + run_.gyro_width + run_.accel_width) + (from.temperature ? n : 0) +
                              (from.flags != nullptr ? n : 0);
        std::size_t flags = 0;
        // memory is reserved for the columns of all sensors, also of those without samples
        for (const Sensor& one : sensors) {
            const std::size_t size = n * one.places.size();
            numbers += size * (kTrackedColumns + (one.bank != nullptr ? kLaneColumns : 0));
            flags += size * (one.bank != nullptr ? 3 : 1);
        }
        char* next = static_cast<char*>(room(numbers * 8 + flags));
        const auto whole = [&next](std::size_t count) { return taken<std::int64_t>(next, count); };
        const auto real = [&next](std::size_t count) { return taken<double>(next, count); };
        run_.seq = whole(n);
        run_.device_us = whole(n);
        run_.host_ns = whole(n);
        run_.flags = from.flags != nullptr ? whole(n) : nullptr;
        run_.gyro_dps = real(n * run_.gyro_width);
        run_.accel_ms2 = has_accel ? real(n * run_.accel_width) : nullptr;
        run_.temperature_c = from.temperature ? real(n) : nullptr;
        run_.sensors.assign(sensors.size(), {});
        for (std::size_t k = 0; k < sensors.size(); ++k) {
            if (!has_values(k)) continue;
            const std::size_t size = n * sensors[k].places.size();
            run_.sensors[k].tracked = real(kTrackedColumns * size);
            run_.sensors[k].has_estimates = sensors[k].bank != nullptr && sensors[k].window_left == 0;
            if (sensors[k].bank == nullptr) continue;
            for (double*& column : run_.sensors[k].bank.columns) column = real(size);
        }
        // columns of wider types come first in memory, so all columns are aligned
        for (std::size_t k = 0; k < sensors.size(); ++k) {
            if (!has_values(k)) continue;
            const std::size_t size = n * sensors[k].places.size();
            run_.sensors[k].moving = taken<std::uint8_t>(next, size);
            if (sensors[k].bank == nullptr) continue;
            run_.sensors[k].bank.valid = taken<std::uint8_t>(next, size);
            run_.sensors[k].bank.white = taken<std::uint8_t>(next, size);
        }
    }

    template <typename T>
    static T* taken(char*& next, std::size_t count) {
        T* const found = reinterpret_cast<T*>(next);
        next += count * sizeof(T);
        return found;
    }

    void scale(const SampleColumns& from, std::size_t at) {
        const std::size_t n = run_.n, bytes = n * sizeof(std::int64_t);
        std::memcpy(run_.seq, seq_.data(), bytes);
        std::memcpy(run_.device_us, device_us_.data(), bytes);
        std::memcpy(run_.host_ns, host_ns_.data(), bytes);
        if (run_.flags != nullptr) std::memcpy(run_.flags, from.flags + at, bytes);
        const std::size_t gyro = run_.gyro_width, accel = run_.accel_width;
        for (std::size_t i = 0; i < n * gyro; ++i)
            run_.gyro_dps[i] = from.gyro[at * gyro + i] / scales.gyro_lsb_per_dps;
        for (std::size_t i = 0; i < n * accel; ++i)
            run_.accel_ms2[i] = from.accel[at * accel + i] * scales.accel_ms2_per_lsb;
        for (std::size_t i = 0; run_.temperature_c != nullptr && i < n; ++i)
            run_.temperature_c[i] =
                from.temperature[at + i] / scales.temperature_lsb_per_c + scales.temperature_zero_c;
    }

    RunColumns run_;
    std::vector<std::int64_t> seq_, device_us_, host_ns_;
    std::vector<std::vector<double>> values_;  // for each sensor, the samples of its axes
    // number of rows of the present run, and number of its events, that were returned to the caller
    std::size_t given_ = 0, told_ = 0;
    std::vector<Happening> pending_, happened_;
    std::vector<std::vector<Lost>> lost_;
    Moment moment_ = {};
    bool has_moment_ = false;
    Judged judged_ = {};
    std::int64_t judged_ns_ = kNever;
    bool is_judged_ = false;  // whether judged_ already describes the next sample
    bool is_ready_ = false;   // whether all work that has to precede the next sample is done
    bool is_new_ = false;     // whether no sample of the present epoch was processed yet
    bool window_is_full_ = false;
};

// Describes which columns a run has, as a list of numbers. First four numbers: number of axes of the
// gyroscope, number of axes of the accelerometer or 0, 1 if there are temperatures else 0, and 1 if there are
// flags else 0. Then three numbers for each sensor: its number of axes (0 if it has no samples), 1 if it is
// the accelerometer else 0, and 1 if it has estimates else 0.
using RunShape = std::vector<std::size_t>;
// How a RunShape describes sensors without samples: as sensors with 0 axes, or not at all.
enum class Absent { kZero, kLeftOut };

inline RunShape shape_of(const Device& device, Absent absent) {
    const RunColumns& run = device.run();
    RunShape shape = {run.gyro_width, run.accel_ms2 == nullptr ? 0 : run.accel_width,
                      run.temperature_c != nullptr, run.flags != nullptr};
    for (std::size_t k = 0; k < run.sensors.size(); ++k) {
        const bool has_samples = run.sensors[k].tracked != nullptr;
        if (!has_samples && absent == Absent::kLeftOut) continue;
        shape.push_back(has_samples ? device.sensors[k].places.size() : 0);
        shape.push_back(device.sensors[k].is_accel);
        shape.push_back(has_samples && run.sensors[k].has_estimates);
    }
    return shape;
}

}  // namespace fltea
