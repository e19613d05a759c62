// Collects rows of samples from the runs of a device, for a caller that fetches many rows at once. A run is a
// series of samples that were processed together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "device.hpp"

namespace fltea {

class RunRows {
  public:
    bool takes(const Device& device) const { return rows_ == 0 || shape_ == shape_of(device, Absent::kZero); }

    // Appends rows of the newest run of `device` (the samples that it processed together last) with their
    // arrival times.
    void append(const Device& device, const std::int64_t* arrived_ns, std::size_t begin, std::size_t end) {
        if (rows_ == 0) {
            shape_ = shape_of(device, Absent::kZero);
            first_ns_ = arrived_ns[0];
        }
        const RunColumns& run = device.run();
        next_ = 0;
        const std::size_t whole = sizeof(std::int64_t), real = sizeof(double);
        add(arrived_ns, 0, end - begin, whole);
        for (const std::int64_t* column : {run.seq, run.device_us, run.host_ns})
            add(column, begin, end, whole);
        add(run.gyro_dps, begin, end, run.gyro_width * real);
        if (run.accel_ms2 != nullptr) add(run.accel_ms2, begin, end, run.accel_width * real);
        if (run.temperature_c != nullptr) add(run.temperature_c, begin, end, real);
        if (run.flags != nullptr) add(run.flags, begin, end, whole);
        for (std::size_t k = 0; k < run.sensors.size(); ++k) {
            const SensorColumns& one = run.sensors[k];
            const std::size_t axes = device.sensors[k].places.size();
            if (one.tracked == nullptr) continue;
            for (std::size_t c = 0; c < kTrackedColumns; ++c)
                add(one.tracked + c * run.n * axes, begin, end, axes * real);
            add(one.moving, begin, end, axes);
            if (!one.has_estimates) continue;
            for (std::size_t c = 0; c < kLaneInnovationStd; ++c)
                add(one.bank.columns[c], begin, end, axes * real);
            add(one.bank.valid, begin, end, axes);
            add(one.bank.white, begin, end, axes);
        }
        rows_ += end - begin;
    }

    std::size_t rows() const { return rows_; }
    const RunShape& shape() const { return shape_; }
    // Arrival time of the first row that waits to be fetched.
    std::int64_t first_ns() const { return first_ns_; }
    // Number of columns. The arrival times come first, then the columns of the samples, then for each sensor
    // the columns of its tracker, and those of its filters' estimates if it has any.
    std::size_t columns() const { return next_; }
    const std::vector<char>& column(std::size_t i) const { return columns_[i]; }

    void clear() {
        for (std::vector<char>& one : columns_) one.clear();
        rows_ = 0;
    }

  private:
    template <typename T>
    void add(const T* from, std::size_t begin, std::size_t end, std::size_t row_bytes) {
        if (next_ == columns_.size()) columns_.emplace_back();
        std::vector<char>& to = columns_[next_++];
        const char* const first = reinterpret_cast<const char*>(from);
        to.insert(to.end(), first + begin * row_bytes, first + end * row_bytes);
    }

    RunShape shape_;
    std::size_t rows_ = 0, next_ = 0;
    std::int64_t first_ns_ = 0;
    std::vector<std::vector<char>> columns_;
};

}  // namespace fltea
