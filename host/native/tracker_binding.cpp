// fltea._native.Tracker: the biases of all axes of a sensor for Python (host/fltea/estimator/tracker.py).
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
#include "sensor_binding.hpp"
#include "tracker.hpp"

namespace nb = nanobind;

namespace {

using Lane = fltea::track::Tracker;
using System = fltea::track::System<fltea::track::kMost>;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr double kLargestStep = 1e200;

void copy(const Vector& from, double* to, size_t n) {
    if (from.shape(0) != n) throw nb::value_error("the system's columns differ in length");
    for (size_t i = 0; i < n; ++i) to[i] = from.data()[i];
}

void copy(const Matrix& from, double* to, size_t n) {
    if (from.shape(0) != n || from.shape(1) != n)
        throw nb::value_error("the system's matrices differ in size");
    for (size_t i = 0; i < n * n; ++i) to[i] = from.data()[i];
}

System system_of(int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state, Vector bias, Matrix P0,
                 double R) {
    const size_t n = a.shape(0);
    if (n > static_cast<size_t>(fltea::track::kMost))
        throw nb::value_error("the system has too many coordinates");
    if (pairs < 0 || 2 * static_cast<size_t>(pairs) > n)
        throw nb::value_error("the system has too many pole pairs");
    System s = System();
    s.n = static_cast<int>(n);
    s.pairs = pairs;
    s.R = R;
    copy(a, s.a, n);
    copy(b, s.b, n);
    copy(c, s.c, n);
    copy(state, s.state, n);
    copy(bias, s.bias, n);
    copy(Q, s.Q, n);
    copy(P0, s.P0, n);
    // What could not be loaded cannot be set.
    std::vector<double> numbers;
    fltea::NumberSaver saver(numbers);
    s.visit(saver);
    fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    s.visit(loader);
    if (!loader.sound()) throw nb::value_error("no filter can work with such a system");
    return s;
}

// What a lane remembers, as it was: nothing changes it, so it may be asked in any thread.
class Remembered {
  public:
    explicit Remembered(const Lane& lane) : memory_(lane.memory()), of_walks_(lane.likelihood()) {}

    double likelihood(int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state, Vector bias, Matrix P0,
                      double R) const {
        const System system = system_of(pairs, a, b, Q, c, state, bias, P0, R);
        nb::gil_scoped_release release;
        return memory_.likelihood(system);
    }

    // The same for each variance of a step of the last coordinate.
    std::vector<double> likelihoods(std::vector<double> steps, int pairs, Vector a, Vector b, Matrix Q,
                                    Vector c, Vector state, Vector bias, Matrix P0, double R) const {
        System system = system_of(pairs, a, b, Q, c, state, bias, P0, R);
        if (system.n == 0) throw nb::value_error("the system has no coordinate that could walk");
        for (const double step : steps) {
            if (!(step >= 0 && step <= kLargestStep)) throw nb::value_error("no offset walks like that");
        }
        nb::gil_scoped_release release;
        for (double& one : steps) {
            system.Q[system.n * system.n - 1] = one;
            one = memory_.likelihood(system);
        }
        return steps;
    }

    double of_walks() const { return of_walks_; }

  private:
    fltea::track::Remembered memory_;
    double of_walks_;
};

class Tracker : public SensorTracker {
  public:
    explicit Tracker(const std::vector<std::optional<double>>& offsets) : offsets_(offsets) {
        if (offsets.empty()) throw nb::value_error("there must be at least one lane");
        make(lanes_);
    }

    // out: (columns, rows, lanes); moving: (rows, lanes).
    void run(Rows y, Results out, Places moving) {
        const size_t rows = y.shape(0), lanes = lanes_.size();
        if (y.shape(1) != lanes || out.shape(0) != static_cast<size_t>(kTrackedColumns) ||
            out.shape(1) != rows || out.shape(2) != lanes || moving.shape(0) != rows ||
            moving.shape(1) != lanes)
            throw nb::value_error("y must have shape (rows, lanes)");
        check_numbers("y", y.data(), rows, lanes, nullptr, kLargestSample);
        const LockGivenAway given(rows);
        run(y.data(), rows, out.data(), moving.data());
    }

    void run(const double* y, size_t rows, double* out, uint8_t* moving) override {
        const size_t lanes = lanes_.size(), all = rows * lanes;
        const std::lock_guard<std::mutex> alone(mutex_);
        for (size_t lane = 0; lane < lanes; ++lane) {
            for (size_t i = lane; i < all; i += lanes) {
                const fltea::track::Tracked one = lanes_[lane].next(y[i]);
                out[i] = one.state;
                out[all + i] = one.state_std;
                out[2 * all + i] = one.bias;
                out[3 * all + i] = one.bias_std;
                out[4 * all + i] = one.innovation;
                moving[i] = one.moving ? 1 : 0;
            }
        }
    }

    void skip(double count) {
        if (!(count >= 0 && count <= 1e15)) throw nb::value_error("no such number of samples can be lost");
        const std::lock_guard<std::mutex> alone(mutex_);
        for (Lane& lane : lanes_) lane.skip(static_cast<uint64_t>(count));
    }

    void set(size_t lane, bool absolute, int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state,
             Vector bias, Matrix P0, double R) {
        const System system = system_of(pairs, a, b, Q, c, state, bias, P0, R);
        const std::lock_guard<std::mutex> alone(mutex_);
        if (!at(lane).set(system, absolute)) throw nb::value_error("no filter can work with such a system");
    }

    Remembered remembered(size_t lane) {
        const std::lock_guard<std::mutex> alone(mutex_);
        return Remembered(at(lane));
    }

    std::tuple<double, std::vector<double>> x(size_t lane) {
        const std::lock_guard<std::mutex> alone(mutex_);
        const Lane& one = at(lane);
        std::vector<double> found(static_cast<size_t>(one.size()));
        if (!found.empty()) std::memcpy(found.data(), one.x(), found.size() * sizeof(double));
        return {one.origin(), std::move(found)};
    }

    // Of each lane: samples in motion, how often it began again, lag1, nis, Ljung and Box's statistic and of
    // how many innovations it is.
    std::vector<std::tuple<uint64_t, uint64_t, double, double, double, int>> stats() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<std::tuple<uint64_t, uint64_t, double, double, double, int>> all;
        for (const Lane& lane : lanes_) {
            const fltea::Whiteness& white = lane.whiteness();
            const fltea::Whiteness::LjungBox test = white.ljung_box();
            all.emplace_back(lane.counts().moved, lane.counts().begun, white.lag1(), white.nis(), test.value,
                             test.n);
        }
        return all;
    }

    nb::bytes save() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<double> numbers;
        fltea::NumberSaver saver(numbers);
        for (const Lane& lane : lanes_) const_cast<Lane&>(lane).visit(saver);
        return nb::bytes(numbers.data(), numbers.size() * sizeof(double));
    }

    void load(nb::bytes bytes) {
        std::vector<double> numbers(bytes.size() / sizeof(double));
        if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
        std::vector<Lane> lanes;
        make(lanes);
        fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
        for (Lane& lane : lanes) lane.visit(loader);
        if (!loader.sound() || !loader.at_end() || bytes.size() % sizeof(double) != 0)
            throw nb::value_error("what the tracker has seen cannot be read");
        const std::lock_guard<std::mutex> alone(mutex_);
        lanes_ = std::move(lanes);
    }

  private:
    void make(std::vector<Lane>& lanes) const {
        lanes.clear();
        for (const std::optional<double>& one : offsets_) lanes.emplace_back(one ? &*one : nullptr);
    }
    Lane& at(size_t lane) {
        if (lane >= lanes_.size()) throw nb::index_error("no such lane");
        return lanes_[lane];
    }

    std::vector<std::optional<double>> offsets_;
    std::vector<Lane> lanes_;
    mutable std::mutex mutex_;
};

}  // namespace

void bind_tracker(nb::module_& m) {
    m.attr("TRACKER_COORDINATES") = static_cast<int>(fltea::track::kMost);
    nb::class_<Remembered>(m, "Remembered")
        .def("likelihood", &Remembered::likelihood)
        .def("likelihoods", &Remembered::likelihoods)
        .def("of_walks", &Remembered::of_walks);
    nb::class_<Tracker, SensorTracker>(m, "Tracker")
        .def(nb::init<const std::vector<std::optional<double>>&>(), nb::arg("offsets"))
        .def("run", nb::overload_cast<Rows, Results, Places>(&Tracker::run), nb::arg("y"), nb::arg("out"),
             nb::arg("moving"))
        .def("skip", &Tracker::skip, nb::arg("count"))
        .def("set", &Tracker::set)
        .def("remembered", &Tracker::remembered, nb::arg("lane"))
        .def("x", &Tracker::x, nb::arg("lane"))
        .def("stats", &Tracker::stats)
        .def("save", &Tracker::save)
        .def("load", &Tracker::load, nb::arg("bytes"));
}
