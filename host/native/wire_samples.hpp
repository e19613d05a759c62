// Samples from a serial port as columns. The columns of the next samples use the same memory again.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder.hpp"
#include "port_read.hpp"
#include "sample_columns.hpp"

namespace fltea {

class WireSamples {
  public:
    // Converts samples to columns. `reads`: the reads of the port with which the samples came. `base`: number
    // of bytes of the input that came before the bytes that were passed to the decoder. It is needed because
    // the ends in `reads` are counted from the first byte of the input, but the ends of the samples from the
    // decoder's first byte.
    void lay_out(const std::vector<SampleRow>& samples, const PortRead* reads, std::int64_t base) {
        const std::size_t n = samples.size();
        for (std::vector<std::int64_t>* column : {&sequence_, &device_us_, &host_ns_, &flags_})
            column->resize(n);
        for (std::vector<std::int16_t>* column : {&gyro_, &accel_}) column->resize(3 * n);
        temperature_.resize(n);
        for (std::size_t i = 0; i < n; ++i) {
            const SampleRow& row = samples[i];
            while (reads->end - base < row.end) ++reads;
            sequence_[i] = row.sequence;
            device_us_[i] = row.device_us;
            host_ns_[i] = reads->stamp.host_ns;
            flags_[i] = row.sample.flags;
            temperature_[i] = row.sample.temperature;
            const std::int16_t gyro[] = {row.sample.gyro_x, row.sample.gyro_y, row.sample.gyro_z};
            const std::int16_t accel[] = {row.sample.accel_x, row.sample.accel_y, row.sample.accel_z};
            std::copy(gyro, gyro + 3, &gyro_[3 * i]);
            std::copy(accel, accel + 3, &accel_[3 * i]);
        }
    }

    // Returns the end of a series of samples whose sequence numbers follow each other without a gap. The
    // series begins at index `from`. The result is the index after the last sample of the series, and is at
    // most `stop`.
    std::size_t end_of_sequence(std::size_t from, std::size_t stop) const {
        std::size_t end = from + 1;
        while (end < stop && sequence_[end] - sequence_[end - 1] == 1) ++end;
        return end;
    }

    // Returns the columns of the samples from index `from` to before `end`. They are valid until the next
    // call of lay_out().
    SampleColumns rows(std::size_t from, std::size_t end) const {
        const auto counts = [from](const std::vector<std::int16_t>& column, std::size_t width) {
            return NumberColumn(column.data() + width * from, NumberColumn::kCounts, width);
        };
        return {end - from,       &sequence_[from],  &device_us_[from],       &host_ns_[from],
                counts(gyro_, 3), counts(accel_, 3), counts(temperature_, 1), &flags_[from]};
    }

  private:
    std::vector<std::int64_t> sequence_, device_us_, host_ns_, flags_;
    std::vector<std::int16_t> gyro_, accel_, temperature_;
};

}  // namespace fltea
