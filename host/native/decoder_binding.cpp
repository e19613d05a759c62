// fltea._native.Decoder: the wire's bytes in, columns of numpy and everything else in order out.
// fltea.wire.block_reader is the interface for people.
#include "decoder_binding.hpp"

#include <cstring>
#include <mutex>
#include <optional>

#include "decoder.hpp"

namespace nb = nanobind;

namespace {

using fltea::Decoded;
using fltea::OtherRow;
using fltea::Reason;
using fltea::SampleRow;

// From here on [bytes] others may run meanwhile. For less the work is done before another thread would have
// taken over, and to ask for the lock back can cost milliseconds.
constexpr std::size_t kWorthReleasing = 16384;

// Holds the buffer of a bytes-like object.
class View {
  public:
    explicit View(nb::handle object) {
        if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_SIMPLE) != 0) nb::raise_python_error();
    }
    ~View() { PyBuffer_Release(&view_); }
    View(const View&) = delete;
    View& operator=(const View&) = delete;

    const std::uint8_t* data() const { return static_cast<const std::uint8_t*>(view_.buf); }
    std::size_t size() const { return static_cast<std::size_t>(view_.len); }

  private:
    Py_buffer view_;
};

// Columns of n rows one behind the other in one bytearray, which the arrays keep alive: numpy.ndarray makes
// an array of it in a seventh of a microsecond, nanobind's own arrays take twice as long.
class Columns {
  public:
    Columns(nb::handle ndarray, std::size_t rows, std::size_t row_bytes)
        : ndarray_(ndarray),
          one_wide_(nb::make_tuple(rows)),
          three_wide_(nb::make_tuple(rows, 3)),
          buffer_(
              nb::steal(PyByteArray_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(rows * row_bytes)))) {
        if (!buffer_.is_valid()) nb::raise_python_error();
        next_ = PyByteArray_AsString(buffer_.ptr());
    }

    // `values(row, out)` writes the numbers of a row. Wider types come first, so that all are aligned.
    template <typename T, std::size_t Width, typename Values>
    nb::object add(nb::handle dtype, const std::vector<SampleRow>& samples, Values values) {
        char* const start = next_;
        for (const SampleRow& row : samples) {
            T numbers[Width];
            values(row, numbers);
            std::memcpy(next_, numbers, sizeof numbers);
            next_ += sizeof numbers;
        }
        const std::ptrdiff_t offset = start - PyByteArray_AsString(buffer_.ptr());
        return ndarray_(Width == 1 ? one_wide_ : three_wide_, dtype, buffer_, offset);
    }

  private:
    nb::handle ndarray_;
    nb::tuple one_wide_, three_wide_;
    nb::object buffer_;
    char* next_ = nullptr;
};

class Decoder {
  public:
    Decoder() {
        const nb::module_ numpy = nb::module_::import_("numpy");
        ndarray_ = numpy.attr("ndarray");
        const auto dtype = [&numpy](const char* name) { return numpy.attr("dtype")(name); };
        int64_ = dtype("int64");
        int16_ = dtype("int16");
        for (std::size_t i = 0; i < kReasons; ++i) {
            const char* name = fltea::reason_name(static_cast<Reason>(i));
            reasons_[i] = name ? nb::object(nb::str(name)) : nb::none();
        }
    }

    nb::tuple feed(nb::handle bytes) {
        const View view(bytes);
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

    // None for no samples.
    nb::object columns(const std::vector<SampleRow>& samples) const {
        if (samples.empty()) return nb::none();
        Columns table(ndarray_, samples.size(), 8 + 8 + 8 + 8 + 6 + 6 + 2);
        const auto end = table.add<std::int64_t, 1>(int64_, samples,
                                                    [](const SampleRow& row, auto* out) { *out = row.end; });
        const auto device_us = table.add<std::int64_t, 1>(
            int64_, samples, [](const SampleRow& row, auto* out) { *out = row.device_us; });
        const auto sequence = table.add<std::int64_t, 1>(
            int64_, samples, [](const SampleRow& row, auto* out) { *out = row.sequence; });
        const auto flags = table.add<std::int64_t, 1>(
            int64_, samples, [](const SampleRow& row, auto* out) { *out = row.sample.flags; });
        const auto gyro = table.add<std::int16_t, 3>(int16_, samples, [](const SampleRow& row, auto* out) {
            out[0] = row.sample.gyro_x;
            out[1] = row.sample.gyro_y;
            out[2] = row.sample.gyro_z;
        });
        const auto accel = table.add<std::int16_t, 3>(int16_, samples, [](const SampleRow& row, auto* out) {
            out[0] = row.sample.accel_x;
            out[1] = row.sample.accel_y;
            out[2] = row.sample.accel_z;
        });
        const auto temperature = table.add<std::int16_t, 1>(
            int16_, samples, [](const SampleRow& row, auto* out) { *out = row.sample.temperature; });
        return nb::make_tuple(sequence, device_us, gyro, accel, temperature, flags, end);
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
    nb::object ndarray_, int64_, int16_;
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
