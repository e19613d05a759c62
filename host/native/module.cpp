// The Python module fltea._native. It has the decoder of the wire protocol, the estimator engine with its
// supervisors, the fits of spectra, and the device's encoder, with which tests compare the Python encoder.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "cobs.h"
#include "crc32.h"
#include "decoder_binding.hpp"
#include "engine_binding.hpp"
#include "frame.h"
#include "messages.h"
#include "tracker_model_binding.hpp"
#include "whittle_binding.hpp"

namespace nb = nanobind;

extern const char kSourceHash[];  // defined in a file that source_hash.py generates

namespace {

const uint8_t* data(const nb::bytes& bytes) { return static_cast<const uint8_t*>(bytes.data()); }

[[noreturn]] void reject(const char* field, const std::string& why) {
    throw nb::value_error((std::string(field) + ": " + why).c_str());
}

// A visitor for the fields of a message (messages.h). It sets the fields in order from the elements of a
// tuple.
class FieldReader {
  public:
    explicit FieldReader(nb::tuple values) : values_(values) {}

    template <typename T>
    void operator()(const char* name, T& field) {
        if constexpr (std::is_enum_v<T>) {
            field = static_cast<T>(integer<std::underlying_type_t<T>>(name));
        } else if constexpr (std::is_same_v<T, float>) {
            const double value = nb::cast<double>(next(name));
            field = static_cast<float>(value);
            if (std::isinf(field) && !std::isinf(value))
                reject(name, std::to_string(value) + " does not fit");
        } else {
            field = integer<T>(name);
        }
    }

    template <size_t N>
    void operator()(const char* name, uint8_t (&field)[N]) {
        nb::bytes value = nb::cast<nb::bytes>(next(name));
        if (value.size() != N) reject(name, "must be " + std::to_string(N) + " bytes");
        std::memcpy(field, value.data(), N);
    }

    template <size_t N>
    void operator()(const char* name, char (&field)[N]) {
        std::string value = nb::cast<std::string>(next(name));
        if (value.size() > N) reject(name, "at most " + std::to_string(N) + " characters fit");
        std::memset(field, 0, N);
        std::memcpy(field, value.data(), value.size());
    }

    void end() const {
        if (used_ != values_.size()) throw nb::value_error("more values than fields");
    }

  private:
    nb::object next(const char* name) {
        if (used_ == values_.size()) reject(name, "no value");
        return nb::borrow(values_[used_++]);
    }

    template <typename T>
    T integer(const char* name) {
        long long value = nb::cast<long long>(next(name));
        if (value < std::numeric_limits<T>::min() || value > std::numeric_limits<T>::max()) {
            reject(name, std::to_string(value) + " does not fit");
        }
        return static_cast<T>(value);
    }

    nb::tuple values_;
    size_t used_ = 0;
};

template <typename Message>
nb::bytes encode_struct(uint16_t sequence, uint32_t device_us, nb::tuple fields) {
    Message message;
    FieldReader read(fields);
    Message::visit_fields(message, read);
    read.end();
    uint8_t wire[fltea::kMaxWire];
    size_t n = fltea::encode_message(message, sequence, device_us, wire);
    return nb::bytes(wire, n);
}

nb::bytes encode_message(uint8_t type, uint16_t sequence, uint32_t device_us, nb::tuple fields) {
    switch (type) {
        case fltea::Hello::type():
            return encode_struct<fltea::Hello>(sequence, device_us, fields);
        case fltea::Sample::type():
            return encode_struct<fltea::Sample>(sequence, device_us, fields);
        case fltea::Status::type():
            return encode_struct<fltea::Status>(sequence, device_us, fields);
        case fltea::Fault::type():
            return encode_struct<fltea::Fault>(sequence, device_us, fields);
        case fltea::Estimate::type():
            return encode_struct<fltea::Estimate>(sequence, device_us, fields);
        case fltea::Estimator::type():
            return encode_struct<fltea::Estimator>(sequence, device_us, fields);
        case fltea::Fit::type():
            return encode_struct<fltea::Fit>(sequence, device_us, fields);
        case fltea::Spectrum::type():
            return encode_struct<fltea::Spectrum>(sequence, device_us, fields);
        default:
            throw nb::value_error("no message of this type");
    }
}

nb::bytes encode_frame(uint8_t type, uint16_t sequence, uint32_t device_us, nb::bytes payload) {
    uint8_t wire[fltea::kMaxWire];
    size_t n = fltea::encode_frame(type, sequence, device_us, data(payload), payload.size(), wire);
    if (n == 0) throw nb::value_error("the payload is too long");
    return nb::bytes(wire, n);
}

nb::bytes cobs_encode(nb::bytes bytes) {
    std::vector<uint8_t> out(fltea::cobs_max_encoded(bytes.size()));
    size_t n = fltea::cobs_encode(data(bytes), bytes.size(), out.data());
    return nb::bytes(out.data(), n);
}

}  // namespace

NB_MODULE(_native, m) {
    m.doc() = "Native parts of fltea.";
    // Leaked objects are reported only in Python's development mode (-X dev). The command exits without a
    // garbage collection (host/fltea/cli/app.py), so objects in reference cycles would be reported as leaks.
    nb::set_leak_warnings(PyObject_IsTrue(nb::module_::import_("sys").attr("flags").attr("dev_mode").ptr()) ==
                          1);
    m.attr("SCHEMA_HASH") = fltea::kSchemaHash;
    m.attr("SOURCE_HASH") = static_cast<const char*>(kSourceHash);
    m.def("crc32", [](nb::bytes bytes) { return fltea::crc32(data(bytes), bytes.size()); }, nb::arg("data"));
    m.def("cobs_encode", &cobs_encode, nb::arg("data"));
    m.def("encode_frame", &encode_frame, nb::arg("type"), nb::arg("sequence"), nb::arg("device_us"),
          nb::arg("payload"));
    m.def("encode_message", &encode_message, nb::arg("type"), nb::arg("sequence"), nb::arg("device_us"),
          nb::arg("fields"));
    bind_decoder(m);
    bind_engine(m);
    bind_lanes(m);
    bind_device(m);
    bind_bank(m);
    bind_whittle_fits(m);
    bind_allan(m);
    bind_octaves(m);
    bind_tracker_model(m);
    bind_tracker(m);
    bind_lines(m);
    bind_rows(m);
    bind_mcap(m);
    bind_port_reader(m);
    bind_round(m);
    bind_port_decoder(m);
}
