// Makes the tracker of the biases of all axes of a sensor available in Python as fltea._native.Tracker
// (host/fltea/estimator/tracker.py).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

#include "engine_binding.hpp"
#include "number_io.hpp"
#include "sensor.hpp"
#include "sensor_tracker.hpp"
#include "tracker_model_binding.hpp"

namespace nb = nanobind;

namespace {

using Lane = fltea::track::AxisTracker;
using Event = fltea::track::TrackerEvent;

// The fields of TrackerEvent, in order: kind, row, axis, number of samples since the event began, size,
// standard deviation of the size, duration of the motion.
using EventTuple = std::tuple<int, size_t, int, std::int64_t, double, double, std::int64_t>;

class Tracker : public fltea::TrackerPart {
  public:
    Tracker(const std::vector<std::optional<double>>& offsets, std::int64_t ahead,
            const std::vector<std::int64_t>& checked, double largest_step, double largest_gravity_step,
            std::int64_t still, std::int64_t patience, bool settles)
        : offsets_(offsets), largest_gravity_step_(largest_gravity_step) {
        if (offsets.empty()) throw nb::value_error("there must be at least one lane");
        if (ahead < 0 || ahead > kLongest || checked.size() > fltea::track::BiasCheck::kTimes)
            throw nb::value_error("ahead must be 0 to 2^40 samples, and checked must have at most 3 numbers");
        if (!(largest_step > 0 && largest_gravity_step > 0 && still > 0 && patience > 0))
            throw nb::value_error("the largest steps, still and patience must be above 0");
        rules_.ahead = ahead;
        for (size_t i = 0; i < checked.size(); ++i) {
            if (checked[i] < 0 || checked[i] > kLongest)
                throw nb::value_error("the numbers in checked must be 0 to 2^40 samples");
            rules_.checked[i] = checked[i];
        }
        rules_.largest_step = largest_step;
        rules_.still = still;
        rules_.patience = patience;
        rules_.settles = settles;
        fltea::track::Tracked nothing = {};
        nothing.bias = nothing.bias_std = __builtin_nan("");
        newest_.assign(offsets.size(), nothing);
        make(sensor_);
    }

    // Processes rows. A lane is one axis. `out` has the shape (columns, rows, lanes), `moving` (rows, lanes)
    // and `accel` (rows, 1 to 3). `rest` is a value of Rest.
    std::vector<EventTuple> run(Rows y, Results out, Places moving, std::optional<Rows> accel, int rest) {
        const size_t rows = y.shape(0), lanes = offsets_.size();
        if (y.shape(1) != lanes || out.shape(0) != static_cast<size_t>(fltea::kTrackedColumns) ||
            out.shape(1) != rows || out.shape(2) != lanes || moving.shape(0) != rows ||
            moving.shape(1) != lanes)
            throw nb::value_error("y must have shape (rows, lanes)");
        if (accel && (accel->shape(0) != rows || accel->shape(1) < 1 || accel->shape(1) > 3))
            throw nb::value_error("accel must have shape (rows, 1 to 3)");
        if (rest < fltea::track::kUnknown || rest > fltea::track::kMoving)
            throw nb::value_error("rest must be 0, 1 or 2");
        check_numbers("y", y.data(), rows, lanes, nullptr, fltea::kLargestSample);
        if (accel)
            check_numbers("accel", accel->data(), rows, accel->shape(1), nullptr, fltea::kLargestSample);
        std::vector<Event> events;
        {
            const LockGivenAway given(rows);
            walk(y.data(), accel ? accel->data() : nullptr, accel ? accel->shape(1) : 0, rows,
                 static_cast<fltea::track::Rest>(rest), out.data(), moving.data(), events);
        }
        std::vector<EventTuple> found;
        for (const Event& one : events)
            found.emplace_back(one.kind, one.row, one.axis, one.ago, one.size, one.size_std, one.samples);
        return found;
    }

    void run(const double* y, const double* accel, size_t accel_axes, size_t rows, double* out,
             uint8_t* moving, std::vector<Event>& events) override {
        walk(y, accel, accel_axes, rows, fltea::track::kUnknown, out, moving, events);
    }

    void skip(double count) {
        if (!(count >= 0 && count <= 1e15))
            throw nb::value_error("the number of lost samples must be 0 to 10^15");
        skip_rows(static_cast<uint64_t>(count));
    }

    void skip_rows(uint64_t count) override {
        const std::lock_guard<std::mutex> alone(mutex_);
        sensor_->skip(count);
    }

    void set(size_t lane, LaneModel& model) {
        const std::unique_ptr<fltea::track::Refiltered> refiltered = model.take_refiltered();
        const std::lock_guard<std::mutex> alone(mutex_);
        if (!at(lane).set(model.model(), refiltered.get()))
            throw nb::value_error(
                "a Kalman filter cannot use this noise model: its numbers are out of range");
    }

    RememberedLane remembered(size_t lane) {
        const std::lock_guard<std::mutex> alone(mutex_);
        return RememberedLane(at(lane));
    }

    std::tuple<double, std::vector<double>> x(size_t lane) {
        const std::lock_guard<std::mutex> alone(mutex_);
        const Lane& one = at(lane);
        std::vector<double> found(static_cast<size_t>(one.size()));
        if (!found.empty()) std::memcpy(found.data(), one.x(), found.size() * sizeof(double));
        return {one.origin(), std::move(found)};
    }

    // Figures of each lane (axis), in this order. First, the numbers of samples in motion, of restarts and of
    // steps. Second, four figures of the innovations: the correlation of neighbours, NIS (the mean of squared
    // innovations over their predicted variance), the Ljung-Box statistic, and the number of innovations from
    // which that statistic is computed. Third, for each length over which the bias is checked, the number of
    // checks, and the root mean square of the ratios of errors to their expected standard deviations. Fourth,
    // the bias and its standard deviation after the newest sample, which are NaN before the first sample.
    using Check = std::tuple<uint64_t, double>;
    using Stats = std::tuple<uint64_t, uint64_t, uint64_t, double, double, double, int, std::vector<Check>,
                             double, double>;
    std::vector<Stats> stats() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<Stats> all;
        for (const Lane& lane : sensor_->axes()) {
            const fltea::Whiteness& white = lane.whiteness();
            const fltea::Whiteness::LjungBox test = white.ljung_box();
            const fltea::track::TrackerCounts& counts = lane.counts();
            std::vector<Check> checks;
            for (int i = 0; i < fltea::track::BiasCheck::kTimes; ++i) {
                const fltea::track::BiasCheck::Found one = lane.check().found(i);
                checks.emplace_back(one.pieces, one.rms);
            }
            all.emplace_back(counts.moved, counts.begun, counts.steps, white.lag1(), white.nis(), test.value,
                             test.n, std::move(checks), newest_[all.size()].bias,
                             newest_[all.size()].bias_std);
        }
        return all;
    }

    bool moving() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return sensor_->moving();
    }

    nb::bytes save() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<double> numbers;
        fltea::NumberSaver saver(numbers);
        sensor_->visit(saver);
        return nb::bytes(numbers.data(), numbers.size() * sizeof(double));
    }

    void load(nb::bytes bytes) {
        std::vector<double> numbers(bytes.size() / sizeof(double));
        if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
        std::unique_ptr<Sensor> sensor;
        make(sensor);
        fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
        sensor->visit(loader);
        if (!loader.sound() || !loader.at_end() || bytes.size() % sizeof(double) != 0)
            throw nb::value_error("the saved state of the tracker cannot be read");
        const std::lock_guard<std::mutex> alone(mutex_);
        sensor_ = std::move(sensor);
    }

  private:
    using Sensor = fltea::track::SensorTracker;
    static constexpr std::int64_t kLongest = std::int64_t(1) << 40;

    void walk(const double* y, const double* accel, size_t accel_axes, size_t rows, fltea::track::Rest rest,
              double* out, uint8_t* moving, std::vector<Event>& events) {
        const size_t lanes = offsets_.size(), all = rows * lanes;
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<fltea::track::Tracked>& now = newest_;
        for (size_t row = 0; row < rows; ++row) {
            sensor_->next(y + row * lanes, accel == nullptr ? nullptr : accel + row * accel_axes,
                          static_cast<int>(accel_axes), rest, row, now.data(), events);
            for (size_t lane = 0; lane < lanes; ++lane) {
                const fltea::track::Tracked& one = now[lane];
                const size_t i = row * lanes + lane;
                out[i] = one.state;
                out[all + i] = one.state_std;
                out[2 * all + i] = one.bias;
                out[3 * all + i] = one.bias_std;
                out[4 * all + i] = one.innovation;
                moving[i] = one.moving ? 1 : 0;
            }
        }
    }

    void make(std::unique_ptr<Sensor>& sensor) const {
        sensor.reset(new Sensor(rules_, largest_gravity_step_));
        for (const std::optional<double>& one : offsets_) sensor->add_axis(one ? &*one : nullptr);
    }
    Lane& at(size_t lane) {
        if (lane >= offsets_.size()) throw nb::index_error("no such lane");
        return sensor_->axes()[lane];
    }

    std::vector<std::optional<double>> offsets_;
    double largest_gravity_step_;
    fltea::track::TrackerRules rules_;
    std::unique_ptr<Sensor> sensor_;
    std::vector<fltea::track::Tracked> newest_;  // the estimates of all lanes after the newest sample
    mutable std::mutex mutex_;
};

}  // namespace

void bind_tracker(nb::module_& m) {
    nb::class_<Tracker, fltea::TrackerPart>(m, "Tracker")
        .def(nb::init<const std::vector<std::optional<double>>&, std::int64_t,
                      const std::vector<std::int64_t>&, double, double, std::int64_t, std::int64_t, bool>(),
             nb::arg("offsets"), nb::arg("ahead"), nb::arg("checked"), nb::arg("largest_step"),
             nb::arg("largest_gravity_step"), nb::arg("still"), nb::arg("patience"), nb::arg("settles"))
        .def("run", nb::overload_cast<Rows, Results, Places, std::optional<Rows>, int>(&Tracker::run),
             nb::arg("y"), nb::arg("out"), nb::arg("moving"), nb::arg("accel").none(), nb::arg("rest"))
        .def("moving", &Tracker::moving)
        .def("skip", &Tracker::skip, nb::arg("count"))
        .def("set", &Tracker::set, nb::arg("lane"), nb::arg("model"))
        .def("remembered", &Tracker::remembered, nb::arg("lane"))
        .def("x", &Tracker::x, nb::arg("lane"))
        .def("stats", &Tracker::stats)
        .def("save", &Tracker::save)
        .def("load", &Tracker::load, nb::arg("bytes"));
}
