// The C++ class behind Python's fltea._native.Device. device_binding.cpp and round_binding.cpp share it.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <optional>
#include <tuple>
#include <vector>

#include "device.hpp"
#include "engine_binding.hpp"
#include "numpy_binding.hpp"
#include "run_printer.hpp"

namespace device_binding {

namespace nb = nanobind;

using fltea::Advanced;
using fltea::Happening;
using fltea::NumberColumn;
using fltea::RunColumns;
using fltea::Stop;

// A column of samples that comes from Python as an array. This object keeps the array alive while the column
// is read.
class Column {
  public:
    Column(nb::handle array, size_t rows) {
        if (array.is_none()) return;
        if (PyObject_GetBuffer(array.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
            PyErr_Clear();  // the elements are not stored row by row without gaps
            const nb::object rows = nb::module_::import_("numpy").attr("ascontiguousarray")(array);
            if (PyObject_GetBuffer(rows.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0)
                nb::raise_python_error();
        }
        held_ = true;
        const bool is_column = view_.ndim == 1 || view_.ndim == 2;
        width_ = view_.ndim == 2 ? static_cast<size_t>(view_.shape[1]) : 1;
        if (!is_column || static_cast<size_t>(view_.shape[0]) != rows || width_ == 0 ||
            view_.format[1] != '\0')
            refuse();
        const char type = view_.format[0];
        if ((type == 'l' || type == 'q') && view_.itemsize == 8) {
            type_ = NumberColumn::kWhole;
        } else if (type == 'd') {
            type_ = NumberColumn::kReal;
        } else if (type == 'h') {
            type_ = NumberColumn::kCounts;
        } else {
            refuse();
        }
    }
    ~Column() {
        if (held_) PyBuffer_Release(&view_);
    }
    Column(const Column&) = delete;
    Column& operator=(const Column&) = delete;

    NumberColumn numbers() const { return {view_.buf, type_, width_}; }
    // Returns the numbers of an int64 column, or null if there is no column.
    const std::int64_t* whole() const {
        if (held_ && type_ != NumberColumn::kWhole) refuse();
        return static_cast<const std::int64_t*>(view_.buf);
    }

  private:
    [[noreturn]] static void refuse() {
        throw nb::value_error(
            "columns of samples must be int64; measured values may also be int16 or float64");
    }

    Py_buffer view_ = {};
    NumberColumn::Type type_ = NumberColumn::kNone;
    size_t width_ = 0;
    bool held_ = false;
};

inline std::optional<double> known(double value) {
    return std::isnan(value) ? std::optional<double>() : std::optional<double>(value);
}

// Returns the details that Python needs to handle a stop of the device (`Stop` in
// host/fltea/stream/decode.py).
inline nb::object told(const fltea::Device& device, const fltea::SampleColumns& from, const Advanced& found) {
    const fltea::Judged& judged = device.judged();
    if (found.stop == Stop::kEpoch) {
        const bool has_accel = from.accel && device.scales.has_accel;
        return nb::make_tuple(fltea::kEpochReasons[static_cast<int>(judged.reason)], judged.missing,
                              judged.seq, judged.epoch_us, from.sequence[found.next],
                              from.device_us[found.next], from.gyro.width(), has_accel);
    }
    if (found.stop == Stop::kGap) {
        nb::list lost;
        for (const std::vector<fltea::Lost>& one : device.lost_meanwhile()) lost.append(as_list(one));
        return nb::make_tuple(judged.missing, judged.seq, device.judged_ns(), lost);
    }
    if (found.stop == Stop::kRateDiffers)
        return nb::make_tuple(device.place.stated_hz(), device.place.measured_hz());
    if (found.stop != Stop::kHappened) return nb::none();
    nb::list happened;
    for (const Happening& one : device.happened()) {
        const fltea::track::TrackerEvent& event = one.event;
        if (one.is_lost) {
            happened.append(nb::make_tuple(one.sensor, as_list({one.lost}), nb::none()));
        } else {
            const nb::tuple of_event = nb::make_tuple(static_cast<int>(event.kind), 0, event.axis, event.ago,
                                                      event.size, event.size_std, event.samples);
            happened.append(nb::make_tuple(one.sensor, nb::none(), of_event));
        }
    }
    return happened;
}

class Device {
  public:
    using Scales = std::tuple<double, std::optional<double>, double, double>;

    void on_hello(double rate_hz, std::int64_t longest_gap, bool is_another_boot, bool is_another_sensor,
                  const Scales& scales) {
        device_.place.on_hello(rate_hz, longest_gap, is_another_boot, is_another_sensor);
        const auto& [gyro, accel, per_c, zero_c] = scales;
        device_.scales = {gyro, accel.has_value(), accel.value_or(0), per_c, zero_c};
    }
    void forget_hello() { device_.place.forget_hello(); }
    bool knows_hello() const { return device_.place.knows_hello(); }
    void on_break(const char* reason) { device_.place.on_break(fltea::epoch_reason_of(reason)); }

    // Begins an epoch (samples without a restart or a long gap). `sensors`: for each sensor, a tuple of the
    // fields of fltea::Sensor (sensor.hpp): is_accel, places, tracker, sums (or None), longest_motion, bank
    // (or None), window_left, waits.
    void begin(std::int64_t offset_ns, nb::list sensors) {
        std::vector<fltea::Sensor> found;
        for (nb::handle sensor : sensors) {
            const nb::tuple one = nb::cast<nb::tuple>(sensor);
            fltea::Sensor to;
            to.is_accel = nb::cast<bool>(one[0]);
            to.places = nb::cast<std::vector<size_t>>(one[1]);
            to.tracker = nb::cast<fltea::TrackerPart*>(one[2]);
            to.sums = nb::cast<fltea::SumsPart*>(one[3]);
            to.longest_motion = nb::cast<std::uint64_t>(one[4]);
            to.bank = nb::cast<fltea::BankPart*>(one[5]);
            to.window_left = nb::cast<size_t>(one[6]);
            to.waits = nb::cast<std::vector<bool>>(one[7]);
            if (to.tracker == nullptr || to.places.empty() || to.waits.size() != to.places.size())
                throw nb::value_error(
                    "a sensor must have a tracker, axes, and one entry of waits for each axis");
            found.push_back(std::move(to));
        }
        kept_ = sensors;
        device_.begin(offset_ns, std::move(found));
    }
    void set_waits(size_t sensor, const std::vector<bool>& waits) {
        if (waits.size() != at(sensor).places.size())
            throw nb::value_error("waits must have one entry for each axis");
        at(sensor).waits = waits;
    }
    size_t window_left(size_t sensor) { return at(sensor).window_left; }

    // Processes samples from index `next` on. `raw` has the columns sequence, device_us, host_ns, gyro,
    // accel, temperature and flags of a RawBlock. Returns four things. First, why it stopped (Stop). Second,
    // the index of the next sample. Third, the result of columns_of() for the processed rows, or None if
    // there are none. Fourth, the details of the stop (told()).
    nb::tuple advance(nb::tuple raw, size_t next) {
        const size_t n = nb::len(nb::handle(raw[0]));
        const Column sequence(raw[0], n), device_us(raw[1], n), host_ns(raw[2], n), gyro(raw[3], n),
            accel(raw[4], n), temperature(raw[5], n), flags(raw[6], n);
        const fltea::SampleColumns from = {n,
                                           sequence.whole(),
                                           device_us.whole(),
                                           host_ns.whole(),
                                           gyro.numbers(),
                                           accel.numbers(),
                                           temperature.numbers(),
                                           flags.whole()};
        if (n > 0 && !from.gyro) throw nb::value_error("samples must have values of the gyroscope");
        Advanced found = {};
        {
            const LockGivenAway given(n - std::min(n, next));
            found = device_.advance(from, next, [this](size_t bytes) {
                const nb::gil_scoped_acquire held;
                table_.emplace(bytes);
                return table_->room<char>(bytes);
            });
            for (fltea::RunPrinter* printer : printers_) printer->append(device_, found.begin, found.end);
        }
        nb::object columns = nb::none();
        if (found.begin < found.end) columns = columns_of(found.begin, found.end);
        return nb::make_tuple(static_cast<int>(found.stop), found.next, columns, told(device_, from, found));
    }

    nb::dict counts() const {
        nb::dict found;
        device_.place.counts().visit([&](const char* name, std::int64_t count) { found[name] = count; });
        return found;
    }
    void note_lost(std::int64_t count) { device_.place.note_lost(count); }
    // Five numbers of the newest sample. The first three are its sequence number, device time and host time
    // as received. The last two are its number and its device time in the epoch.
    std::tuple<std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::int64_t> newest() const {
        const fltea::Newest& one = device_.place.newest();
        return {one.sequence, one.device_us, one.host_ns, one.seq, one.epoch_us};
    }
    std::optional<std::tuple<std::int64_t, std::int64_t, std::int64_t>> moment() const {
        if (!device_.has_moment()) return {};
        const fltea::Moment& one = device_.moment();
        return std::make_tuple(one.seq, one.device_us, one.host_ns);
    }
    std::optional<double> rate_hz() const { return known(device_.timebase.rate_hz()); }
    std::optional<double> clock_ppm() const { return known(device_.timebase.clock_ppm()); }

    // Sets the printers. From now on, they print all samples of this device as JSON lines.
    void set_printers(nb::list printers) {
        std::vector<fltea::RunPrinter*> found;
        for (nb::handle one : printers) found.push_back(&nb::cast<fltea::RunPrinter&>(one));
        printers_ = found;
        kept_printers_ = nb::tuple(printers);
    }

    fltea::Device& native() { return device_; }
    std::vector<fltea::RunPrinter*>& printers() { return printers_; }

  private:
    fltea::Sensor& at(size_t sensor) {
        if (sensor >= device_.sensors.size()) throw nb::index_error("no such sensor");
        return device_.sensors[sensor];
    }

    template <typename T>
    nb::object rows(const T* column, size_t begin, size_t end, size_t width, bool is_flat = false) const {
        if (column == nullptr) return nb::none();
        const size_t n = end - begin;
        return table_->array(column + begin * width, is_flat ? nb::make_tuple(n) : nb::make_tuple(n, width));
    }

    // Returns three things for the rows of the run from `begin` to before `end`. First, the index of the
    // first of these rows in the source. Second, the columns of the samples. Third, a list with an entry for
    // each sensor. If the sensor has no samples, the entry is None. Otherwise it is a pair: the columns of
    // the sensor's tracker, and the columns of its filters' estimates, or None while there are no estimates.
    nb::tuple columns_of(size_t begin, size_t end) const {
        const RunColumns& run = device_.run();
        nb::list sensors;
        for (size_t k = 0; k < run.sensors.size(); ++k) {
            const size_t axes = device_.sensors[k].places.size();
            const fltea::SensorColumns& one = run.sensors[k];
            if (one.tracked == nullptr) {
                sensors.append(nb::none());
                continue;
            }
            nb::list tracked;
            for (size_t c = 0; c < fltea::kTrackedColumns; ++c)
                tracked.append(rows(one.tracked + c * run.n * axes, begin, end, axes));
            tracked.append(rows(one.moving, begin, end, axes));
            nb::object bank = nb::none();
            if (one.has_estimates) {
                nb::list columns;
                for (size_t c = 0; c < fltea::kLaneInnovationStd; ++c)
                    columns.append(rows(one.bank.columns[c], begin, end, axes));
                columns.append(rows(one.bank.valid, begin, end, axes));
                columns.append(rows(one.bank.white, begin, end, axes));
                bank = columns;
            }
            sensors.append(nb::make_tuple(tracked, bank));
        }
        return nb::make_tuple(
            run.first + begin,
            nb::make_tuple(
                rows(run.seq, begin, end, 1, true), rows(run.device_us, begin, end, 1, true),
                rows(run.host_ns, begin, end, 1, true), rows(run.gyro_dps, begin, end, run.gyro_width),
                rows(run.accel_ms2, begin, end, run.accel_width),
                rows(run.temperature_c, begin, end, 1, true), rows(run.flags, begin, end, 1, true)),
            sensors);
    }

    fltea::Device device_;
    std::optional<NumpyTable> table_;  // this array owns the memory for the columns of a run of samples
    nb::object kept_;                  // keeps those Python objects alive to which the sensors point
    std::vector<fltea::RunPrinter*> printers_;
    nb::object kept_printers_;
};

}  // namespace device_binding
