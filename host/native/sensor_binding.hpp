// What of Tracker, Octaves and Bank takes the samples of one sensor's axes: for who has all three, and so
// needs no arrays of Python between them (steady_binding.cpp).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "axis_bank.hpp"
#include "engine_binding.hpp"
#include "sensor_tracker.hpp"

// All take rows of y (rows, axes). Half, so that a number stays within what the engine takes when a bias is
// taken off.
constexpr double kLargestSample = kLargestInput / 2;
enum { kTrackedColumns = 5 };

struct SensorTracker {
    using Event = fltea::track::TrackerEvent;
    virtual ~SensorTracker() = default;
    // accel: (rows, accel_axes), or none. out: (kTrackedColumns, rows, axes); moving: (rows, axes).
    virtual void run(const double* y, const double* accel, std::size_t accel_axes, std::size_t rows,
                     double* out, std::uint8_t* moving, std::vector<Event>& events) = 0;
};

struct SensorSums {
    virtual ~SensorSums() = default;
    virtual void add(const double* y, const std::uint8_t* moving, std::size_t rows,
                     std::uint64_t longest) = 0;
};

struct SensorBank {
    virtual ~SensorBank() = default;
    virtual void run(const double* y, std::size_t rows, const fltea::BankBlock& out,
                     std::vector<fltea::Lost>& lost) = 0;
};
