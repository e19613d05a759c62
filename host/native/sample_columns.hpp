// Consecutive samples of a source as columns of numbers. The memory belongs to the source.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fltea {

// A column of n rows, which are raw counts from the wire or numbers from a file.
class NumberColumn {
  public:
    enum Type { kNone, kCounts, kWhole, kReal };  // types of the numbers: no column; int16; int64; double

    NumberColumn() = default;
    NumberColumn(const void* data, Type type, std::size_t width) : data_(data), type_(type), width_(width) {}

    explicit operator bool() const { return type_ != kNone; }
    std::size_t width() const { return width_; }
    // The raw counts. Call this only for columns of the type kCounts.
    const std::int16_t* counts() const { return static_cast<const std::int16_t*>(data_); }
    // Returns the number at index `i` of the column. The index counts the numbers of all rows one after
    // another.
    double operator[](std::size_t i) const {
        if (type_ == kCounts) return static_cast<const std::int16_t*>(data_)[i];
        if (type_ == kReal) return static_cast<const double*>(data_)[i];
        return static_cast<double>(static_cast<const std::int64_t*>(data_)[i]);
    }

  private:
    const void* data_ = nullptr;
    Type type_ = kNone;
    std::size_t width_ = 0;
};

// The columns of n samples. The class RawSample in host/fltea/records/events.py defines what each column
// means.
struct SampleColumns {
    std::size_t n;
    const std::int64_t *sequence, *device_us, *host_ns;
    NumberColumn gyro, accel, temperature;
    const std::int64_t* flags;  // null if the source has no flags
};

// Scales by which the raw counts of samples are converted to physical units.
struct Scales {
    double gyro_lsb_per_dps;
    bool has_accel;  // whether the accelerometer's scale is known; if not, its samples are not used
    double accel_ms2_per_lsb;
    double temperature_lsb_per_c, temperature_zero_c;
};

}  // namespace fltea
