// Makes the decoder of the wire protocol available in Python as fltea._native.Decoder. It takes the bytes of
// a serial port, and returns samples as numpy columns and all other frames in order. Python code should use
// fltea.wire.block_reader instead.
#include "decoder_binding.hpp"

#include <cstring>
#include <mutex>
#include <optional>

#include "buffer_view.hpp"
#include "decoder.hpp"
#include "numpy_binding.hpp"

namespace nb = nanobind;

namespace {

using fltea::Decoded;
using fltea::OtherRow;
using fltea::Reason;
using fltea::SampleRow;

// If there are at least this many bytes, Python's GIL is released while they are decoded. Fewer bytes are
// decoded so quickly that no other thread would get the GIL, and acquiring the GIL again can take
// milliseconds.
constexpr std::size_t kWorthReleasing = 16384;

class Decoder {
  public:
    Decoder() {
        for (std::size_t i = 0; i < kReasons; ++i) {
            const char* name = fltea::reason_name(static_cast<Reason>(i));
            reasons_[i] = name ? nb::object(nb::str(name)) : nb::none();
        }
    }

    nb::tuple feed(nb::handle bytes) {
        const BufferView view(bytes);
        Decoded found;
        {
            std::optional<nb::gil_scoped_release> release;
            if (view.size() >= kWorthReleasing) release.emplace();
            const std::lock_guard<std::mutex> alone(mutex_);
            decoder_.feed(view.data(), view.size(), found);
        }
        return nb::make_tuple(columns(found.samples), others(found));
    }

    void reset() {
        const std::lock_guard<std::mutex> alone(mutex_);
        decoder_.reset();
    }

    std::size_t pending() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return decoder_.pending();
    }

  private:
    static constexpr std::size_t kReasons = static_cast<std::size_t>(Reason::length) + 1;

    // Returns the columns of the samples, or None if there are no samples.
    nb::object columns(const std::vector<SampleRow>& samples) const {
        if (samples.empty()) return nb::none();
        const std::size_t n = samples.size();
        NumpyTable table(n * (4 * sizeof(std::int64_t) + 7 * sizeof(std::int16_t)));
        auto* const end = table.room<std::int64_t>(n);
        auto* const device_us = table.room<std::int64_t>(n);
        auto* const sequence = table.room<std::int64_t>(n);
        auto* const flags = table.room<std::int64_t>(n);
        auto* const gyro = table.room<std::int16_t>(3 * n);
        auto* const accel = table.room<std::int16_t>(3 * n);
        auto* const temperature = table.room<std::int16_t>(n);
        for (std::size_t i = 0; i < n; ++i) {
            const fltea::Sample& one = samples[i].sample;
            end[i] = samples[i].end;
            device_us[i] = samples[i].device_us;
            sequence[i] = samples[i].sequence;
            flags[i] = one.flags;
            gyro[3 * i] = one.gyro_x;
            gyro[3 * i + 1] = one.gyro_y;
            gyro[3 * i + 2] = one.gyro_z;
            accel[3 * i] = one.accel_x;
            accel[3 * i + 1] = one.accel_y;
            accel[3 * i + 2] = one.accel_z;
            temperature[i] = one.temperature;
        }
        const nb::tuple wide = nb::make_tuple(n), three_wide = nb::make_tuple(n, 3);
        return nb::make_tuple(table.array(sequence, wide), table.array(device_us, wide),
                              table.array(gyro, three_wide), table.array(accel, three_wide),
                              table.array(temperature, wide), table.array(flags, wide),
                              table.array(end, wide));
    }

    nb::list others(const Decoded& found) const {
        nb::list result;
        for (const OtherRow& other : found.others) {
            result.append(nb::make_tuple(
                other.row, other.end, reasons_[static_cast<std::size_t>(other.reason)], other.type,
                other.sequence, other.device_us, nb::bytes(found.bytes.data() + other.offset, other.size)));
        }
        return result;
    }

    fltea::Decoder decoder_;
    mutable std::mutex mutex_;
    nb::object reasons_[kReasons];
};

}  // namespace

void bind_decoder(nb::module_& m) {
    nb::class_<Decoder>(m, "Decoder")
        .def(nb::init<>())
        .def("feed", &Decoder::feed, nb::arg("data"))
        .def("reset", &Decoder::reset)
        .def_prop_ro("pending", &Decoder::pending);
}
