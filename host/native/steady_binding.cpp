// fltea._native.Steady: samples with which nothing happens through all that each sample goes through, in one
// call (host/fltea/stream/steady.py).
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <vector>

#include "numpy_binding.hpp"
#include "sensor_binding.hpp"
#include "steady.hpp"

namespace nb = nanobind;

namespace {

// Numbers of a column of samples, of either type that sources have.
class Column {
  public:
    Column(nb::handle array, size_t rows) {
        if (array.is_none()) return;
        if (PyObject_GetBuffer(array.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
            PyErr_Clear();
            return;
        }
        held_ = true;
        if (view_.ndim < 1 || view_.ndim > 2 || static_cast<size_t>(view_.shape[0]) != rows) return;
        width_ = view_.ndim == 1 ? 1 : static_cast<size_t>(view_.shape[1]);
        type_ = view_.format[0];
        sound_ = width_ > 0 && view_.format[1] == '\0' &&
                 (whole() ? view_.itemsize == 8 : type_ == 'h' || type_ == 'd');
    }
    ~Column() {
        if (held_) PyBuffer_Release(&view_);
    }
    Column(const Column&) = delete;
    Column& operator=(const Column&) = delete;

    explicit operator bool() const { return sound_; }
    bool whole() const { return type_ == 'l' || type_ == 'q'; }
    size_t width() const { return width_; }
    std::int64_t integer(size_t i) const { return static_cast<const std::int64_t*>(view_.buf)[i]; }
    double number(size_t i) const {
        if (type_ == 'h') return static_cast<const std::int16_t*>(view_.buf)[i];
        return type_ == 'd' ? static_cast<const double*>(view_.buf)[i] : static_cast<double>(integer(i));
    }

  private:
    Py_buffer view_ = {};
    size_t width_ = 0;
    char type_ = '\0';
    bool held_ = false, sound_ = false;
};

struct Sensor {
    bool is_accel;
    std::vector<size_t> places;
    SensorTracker* tracker;
    SensorSums* sums;
    std::uint64_t longest;
    SensorBank* bank;
    std::vector<bool> waits;  // axes that are not settled, whatever their innovations are
};

struct Scales {
    double gyro_divisor;
    std::optional<double> accel_factor;
    double temperature_divisor, temperature_c;
};

class Steady {
  public:
    using Rule = std::tuple<double, double, std::int64_t, std::int64_t>;
    using Scale = std::tuple<double, std::optional<double>, double, double>;
    using Place = std::tuple<std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::int64_t>;
    using Clock = std::tuple<std::int64_t, std::int64_t, std::int64_t, double, double, double, std::int64_t>;

    Steady(const Rule& rule, const Scale& scale, const Clock& line, nb::list sensors) {
        std::tie(rule_.period_us, rule_.tolerance_us, rule_.disagreement_ns, rule_.silence_ns) = rule;
        std::tie(scales_.gyro_divisor, scales_.accel_factor, scales_.temperature_divisor,
                 scales_.temperature_c) = scale;
        time_by(line);
        for (nb::handle one : sensors) {
            const nb::tuple sensor = nb::cast<nb::tuple>(one);
            kept_.append(sensor);
            sensors_.push_back(Sensor{nb::cast<bool>(sensor[0]), nb::cast<std::vector<size_t>>(sensor[1]),
                                      nb::cast<SensorTracker*>(sensor[2]), nb::cast<SensorSums*>(sensor[3]),
                                      nb::cast<std::uint64_t>(sensor[4]), nb::cast<SensorBank*>(sensor[5]),
                                      nb::cast<std::vector<bool>>(sensor[6])});
        }
    }

    void time_by(const Clock& line) {
        std::tie(clock_.origin_us, clock_.origin_ns, clock_.offset_ns, clock_.centre_s, clock_.centre_delay_s,
                 clock_.slope, second_end_us_) = line;
    }

    // What came of the first samples, up to one with which anything else is to be done; None, and nothing has
    // changed, if that is the first; its time if the clock's second ends before it. raw: sequence, device_us,
    // host_ns, gyro, accel, temperature, as of RawBlock. place: of the newest sample. stop: a sample with
    // this number, or a later one, may not come, nor one that arrives at until_ns or later. last_ns: Unix
    // time of the newest sample. earliest: arrival in the clock's second.
    nb::object run(nb::tuple raw, const Place& place, std::int64_t stop, std::int64_t until_ns,
                   std::int64_t last_ns, std::optional<std::tuple<double, double>> earliest) {
        const size_t all = nb::len(nb::handle(raw[0]));
        const Column sequence(raw[0], all), device_us(raw[1], all), host_ns(raw[2], all), gyro(raw[3], all),
            accel(raw[4], all), temperature(raw[5], all);
        if (all == 0 || !sequence || !device_us || !host_ns || !gyro || !sequence.whole() ||
            !device_us.whole() || !host_ns.whole())
            return nb::none();
        const bool has_accel = accel && scales_.accel_factor;
        if ((!accel && !raw[4].is_none()) || (!temperature && !raw[5].is_none())) return nb::none();
        fltea::SamplePlace at;
        std::tie(at.sequence, at.device_us, at.host_ns, at.seq, at.epoch_us) = place;
        fltea::SecondOfClock clock = clock_;
        clock.last_ns = last_ns;
        clock.any = earliest.has_value();
        if (earliest) std::tie(clock.earliest_s, clock.earliest_delay_s) = *earliest;
        if (at.seq + 1 >= stop) return nb::none();
        size_t n = std::min(all, static_cast<size_t>(stop - 1 - at.seq));

        size_t numbers =
                   3 * n + n * gyro.width() + (has_accel ? n * accel.width() : 0) + (temperature ? n : 0),
               flags = 0;
        for (const Sensor& one : sensors_) {
            const size_t size = n * one.places.size();
            numbers += size * (kTrackedColumns + (one.bank ? fltea::kLaneColumns : 0));
            flags += size * (one.bank ? 3 : 1);
        }
        NumpyTable table(numbers * 8 + flags);
        auto* const seqs = table.room<std::int64_t>(n);
        auto* const epoch_us = table.room<std::int64_t>(n);
        auto* const unix_ns = table.room<std::int64_t>(n);
        for (size_t i = 0; i < n; ++i) {
            fltea::SamplePlace next = at;
            const bool goes_on =
                next.go_on(rule_, sequence.integer(i), device_us.integer(i), host_ns.integer(i)) &&
                next.host_ns < until_ns;
            if (!goes_on || next.epoch_us >= second_end_us_) {
                if (i == 0) return goes_on ? nb::int_(next.epoch_us) : nb::object(nb::none());
                n = i;
                break;
            }
            at = next;
            seqs[i] = at.seq;
            epoch_us[i] = at.epoch_us;
            unix_ns[i] = clock.time(at.epoch_us, host_ns.integer(i));
        }
        auto* const gyro_dps = table.room<double>(n * gyro.width());
        for (size_t i = 0; i < n * gyro.width(); ++i) gyro_dps[i] = gyro.number(i) / scales_.gyro_divisor;
        double* accel_ms2 = nullptr;
        if (has_accel) {
            accel_ms2 = table.room<double>(n * accel.width());
            for (size_t i = 0; i < n * accel.width(); ++i)
                accel_ms2[i] = accel.number(i) * *scales_.accel_factor;
        }
        double* celsius = nullptr;
        if (temperature) {
            celsius = table.room<double>(n);
            for (size_t i = 0; i < n; ++i)
                celsius[i] = temperature.number(i) / scales_.temperature_divisor + scales_.temperature_c;
        }
        std::vector<Taken> taken(sensors_.size());
        for (size_t k = 0; k < sensors_.size(); ++k) {
            const bool is_accel = sensors_[k].is_accel;
            const double* const from = is_accel ? accel_ms2 : gyro_dps;
            if (!from ||
                !chosen(from, n, is_accel ? accel.width() : gyro.width(), sensors_[k].places, taken[k].y))
                return nb::none();
        }
        // From here on nothing can be refused.
        for (size_t k = 0; k < sensors_.size(); ++k) {
            const size_t axes = sensors_[k].places.size(), size = n * axes;
            taken[k].tracked = table.room<double>(kTrackedColumns * size);
            if (!sensors_[k].bank) continue;
            for (double*& column : taken[k].block.columns) column = table.room<double>(size);
        }
        for (size_t k = 0; k < sensors_.size(); ++k) {
            const size_t size = n * sensors_[k].places.size();
            taken[k].moving = table.room<std::uint8_t>(size);
            if (!sensors_[k].bank) continue;
            taken[k].block.valid = table.room<std::uint8_t>(size);
            taken[k].block.white = table.room<std::uint8_t>(size);
        }
        for (size_t k = 0; k < sensors_.size(); ++k) {
            // The accelerometer's own axes show motion by themselves.
            const double* const of_accel = sensors_[k].is_accel ? nullptr : accel_ms2;
            walk(sensors_[k], of_accel, has_accel ? accel.width() : 0, n, taken[k]);
        }
        const nb::tuple of_rows = nb::make_tuple(n);
        nb::list found;
        for (size_t k = 0; k < sensors_.size(); ++k) found.append(columns(table, sensors_[k], n, taken[k]));
        const nb::object accel_array =
            has_accel ? table.array(accel_ms2, nb::make_tuple(n, accel.width())) : nb::object(nb::none());
        const nb::object celsius_array = celsius ? table.array(celsius, of_rows) : nb::object(nb::none());
        return nb::make_tuple(
            nb::make_tuple(
                table.array(seqs, of_rows), table.array(epoch_us, of_rows), table.array(unix_ns, of_rows),
                table.array(gyro_dps, nb::make_tuple(n, gyro.width())), accel_array, celsius_array),
            found, nb::make_tuple(at.sequence, at.device_us, at.host_ns, at.seq, at.epoch_us),
            nb::make_tuple(clock.last_ns, nb::make_tuple(clock.earliest_s, clock.earliest_delay_s)));
    }

  private:
    struct Taken {
        std::vector<double> y;
        double* tracked = nullptr;
        std::uint8_t* moving = nullptr;
        fltea::BankBlock block = {};
        std::vector<fltea::Lost> lost;
        std::vector<SensorTracker::Event> events;
    };

    // The columns `places` of n rows; false for numbers beyond all measure.
    static bool chosen(const double* from, size_t n, size_t width, const std::vector<size_t>& places,
                       std::vector<double>& y) {
        y.reserve(n * places.size());
        for (size_t i = 0; i < n; ++i) {
            for (const size_t axis : places) {
                if (axis >= width || !(std::fabs(from[i * width + axis]) <= kLargestSample)) return false;
                y.push_back(from[i * width + axis]);
            }
        }
        return true;
    }

    static void walk(const Sensor& one, const double* accel, size_t accel_axes, size_t n, Taken& to) {
        const size_t axes = one.places.size(), size = n * axes;
        one.tracker->run(to.y.data(), accel, accel_axes, n, to.tracked, to.moving, to.events);
        if (one.sums) add_at_rest(one, n, to);
        if (!one.bank) return;
        one.bank->run(to.y.data(), n, to.block, to.lost);
        for (size_t i = 0; i < size; ++i) {
            if (one.waits[i % axes]) to.block.white[i] = 0;
        }
    }

    // Sums break where a bias has stepped, as at motion.
    static void add_at_rest(const Sensor& one, size_t n, const Taken& from) {
        const size_t axes = one.places.size();
        if (from.events.empty()) {
            one.sums->add(from.y.data(), from.moving, n, one.longest);
            return;
        }
        std::vector<std::uint8_t> left_out(from.moving, from.moving + n * axes);
        for (const SensorTracker::Event& event : from.events) {
            if (event.kind == SensorTracker::Event::kStep)
                left_out[event.row * axes + static_cast<size_t>(event.axis)] = 1;
        }
        one.sums->add(from.y.data(), left_out.data(), n, one.longest);
    }

    static nb::tuple columns(const NumpyTable& table, const Sensor& one, size_t n, const Taken& from) {
        const size_t axes = one.places.size();
        const nb::tuple shape = nb::make_tuple(n, axes);
        nb::list tracked;
        for (size_t c = 0; c < kTrackedColumns; ++c)
            tracked.append(table.array(from.tracked + c * n * axes, shape));
        tracked.append(table.array(from.moving, shape));
        nb::object estimates = nb::none();
        if (one.bank) {
            nb::list bank;
            for (size_t c = 0; c < fltea::kLaneInnovationStd; ++c)
                bank.append(table.array(from.block.columns[c], shape));
            bank.append(table.array(from.block.valid, shape));
            bank.append(table.array(from.block.white, shape));
            estimates = nb::tuple(bank);
        }
        nb::list events;
        for (const SensorTracker::Event& event : from.events)
            events.append(nb::make_tuple(static_cast<int>(event.kind), event.row, event.axis, event.ago,
                                         event.size, event.size_std, event.samples));
        return nb::make_tuple(nb::tuple(tracked), estimates, as_list(from.lost), events);
    }

    fltea::FollowRule rule_ = {};
    Scales scales_ = {};
    fltea::SecondOfClock clock_ = {};
    std::int64_t second_end_us_ = 0;
    std::vector<Sensor> sensors_;
    nb::list kept_;  // what the sensors point to
};

}  // namespace

void bind_steady(nb::module_& m) {
    nb::class_<SensorTracker>(m, "SensorTracker");
    nb::class_<SensorSums>(m, "SensorSums");
    nb::class_<SensorBank>(m, "SensorBank");
    nb::class_<Steady>(m, "Steady")
        .def(nb::init<const Steady::Rule&, const Steady::Scale&, const Steady::Clock&, nb::list>(),
             nb::arg("rule"), nb::arg("scale"), nb::arg("line"), nb::arg("sensors"))
        .def("time_by", &Steady::time_by, nb::arg("line"))
        .def("run", &Steady::run, nb::arg("raw"), nb::arg("place"), nb::arg("stop"), nb::arg("until_ns"),
             nb::arg("last_ns"), nb::arg("earliest").none());
}
