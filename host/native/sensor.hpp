// One sensor of a device: the tracker of its biases, the sums from which its noise is fitted, and the filters
// of its axes (AxisBank).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "axis_bank.hpp"
#include "sensor_tracker.hpp"

namespace fltea {

// Largest magnitude of a sample. It is half of the estimator engine's limit, so that a sample minus its bias
// stays within that limit.
constexpr double kLargestSample = kLargestInput / 2;
enum { kTrackedColumns = 5 };

// Interfaces of the three parts of a sensor, which are the tracker, the sums and the filters. Each part
// processes samples y of shape (rows, axes).
struct TrackerPart {
    virtual ~TrackerPart() = default;
    // `accel` has the shape (rows, accel_axes) or is null; `out` has the shape (kTrackedColumns, rows, axes),
    // and `moving` has the shape (rows, axes).
    virtual void run(const double* y, const double* accel, std::size_t accel_axes, std::size_t rows,
                     double* out, std::uint8_t* moving, std::vector<track::TrackerEvent>& events) = 0;
    virtual void skip_rows(std::uint64_t count) = 0;
};

struct SumsPart {
    virtual ~SumsPart() = default;
    virtual void add(const double* y, const std::uint8_t* moving, std::size_t rows,
                     std::uint64_t longest) = 0;
    virtual void skip_rows(std::uint64_t count) = 0;
};

struct BankPart {
    virtual ~BankPart() = default;
    virtual void run(const double* y, std::size_t rows, const BankBlock& out, std::vector<Lost>& lost) = 0;
    virtual void skip_rows(std::uint64_t count, std::vector<Lost>& lost) = 0;
};

// Results for a block of rows. Each column has the shape (rows, axes).
struct SensorColumns {
    // the columns of the tracker, which are kTrackedColumns in number, or null if the sensor has no samples
    double* tracked = nullptr;
    std::uint8_t* moving = nullptr;
    BankBlock bank = {};
    bool has_estimates = false;  // false while the start-up window is not full
};

struct Sensor {
    bool is_accel = false;
    std::vector<std::size_t> places;  // indexes of the sensor's axes in the columns of samples
    TrackerPart* tracker = nullptr;
    SumsPart* sums = nullptr;  // null if no noise is fitted
    std::uint64_t longest_motion = 0;
    BankPart* bank = nullptr;  // null if no filters run
    // for each axis, whether its fit is not accepted yet; until then its innovations do not count as white
    std::vector<bool> waits;
    std::size_t window_left = 0;  // number of rows until the start-up window of `bank` is full

    // Copies the values of this sensor's axes (`places`) from n rows of samples to `y`. Returns false if a
    // value exceeds kLargestSample or an axis does not exist.
    bool choose(const double* from, std::size_t n, std::size_t width, std::vector<double>& y) const {
        y.clear();
        for (std::size_t i = 0; i < n; ++i) {
            for (const std::size_t axis : places) {
                if (axis >= width || !(std::fabs(from[i * width + axis]) <= kLargestSample)) return false;
                y.push_back(from[i * width + axis]);
            }
        }
        return true;
    }

    void run(const std::vector<double>& y, const double* accel, std::size_t accel_axes, std::size_t n,
             const SensorColumns& to, std::vector<track::TrackerEvent>& events, std::vector<Lost>& lost) {
        tracker->run(y.data(), accel, accel_axes, n, to.tracked, to.moving, events);
        if (sums != nullptr) add_at_rest(y, n, to, events);
        if (bank == nullptr) return;
        bank->run(y.data(), n, to.bank, lost);
        if (window_left > 0) {
            window_left -= n;
            return;
        }
        for (std::size_t i = 0; i < n * places.size(); ++i) {
            if (waits[i % places.size()]) to.bank.white[i] = 0;
        }
    }

    void skip(std::uint64_t count, std::vector<Lost>& lost) {
        tracker->skip_rows(count);
        if (sums != nullptr) sums->skip_rows(count);
        if (bank != nullptr) bank->skip_rows(count, lost);
    }

  private:
    // Adds the samples at rest to the sums. The sample at which a step of the bias was noticed is omitted.
    // The omitted sample makes a break in the stream, so that no block of a spectrum extends over the step.
    void add_at_rest(const std::vector<double>& y, std::size_t n, const SensorColumns& from,
                     const std::vector<track::TrackerEvent>& events) {
        const std::size_t axes = places.size();
        std::vector<std::uint8_t> left_out;
        for (const track::TrackerEvent& event : events) {
            if (event.kind != track::TrackerEvent::kStep) continue;
            if (left_out.empty()) left_out.assign(from.moving, from.moving + n * axes);
            left_out[event.row * axes + static_cast<std::size_t>(event.axis)] = 1;
        }
        sums->add(y.data(), left_out.empty() ? from.moving : left_out.data(), n, longest_motion);
    }
};

}  // namespace fltea
