// Makes available in Python: the classes fltea._native.TrackerModel and fltea._native.Remembered
// (host/fltea/estimator/tracker.py), and functions for the linear system of one noise model
// (host/fltea/noise/heading.py).
#include "tracker_model_binding.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "noise_system.hpp"
#include "number_io.hpp"

namespace nb = nanobind;

namespace {

using namespace fltea::track;
using Noise = TrackerModel::Noise;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Square = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr std::int64_t kLongest = std::int64_t(1) << 40;

void copy(const Vector& from, double* to, size_t n) {
    if (from.shape(0) != n) throw nb::value_error("the vectors of the system differ in length");
    for (size_t i = 0; i < n; ++i) to[i] = from.data()[i];
}

void copy(const Matrix& from, double* to, size_t n) {
    if (from.shape(0) != n || from.shape(1) != n)
        throw nb::value_error("the matrices of the system differ in size from its vectors");
    for (size_t i = 0; i < n * n; ++i) to[i] = from.data()[i];
}

// Raises ValueError if `s` has numbers with which no filter can work. The same numbers would be rejected in a
// snapshot.
void check(Noise& s) {
    std::vector<double> numbers;
    fltea::NumberSaver saver(numbers);
    s.visit(saver);
    fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    s.visit(loader);
    if (!loader.sound())
        throw nb::value_error("a Kalman filter cannot use this noise model: its numbers are out of range");
}

Noise system_of(int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state, Vector bias, Matrix P0,
                double R) {
    const size_t n = a.shape(0);
    if (n > static_cast<size_t>(kMost)) throw nb::value_error("the system has too many state variables");
    if (pairs < 0 || 2 * static_cast<size_t>(pairs) > n)
        throw nb::value_error("the system has too many pole pairs");
    Noise s = Noise();
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
    check(s);
    return s;
}

using Numbers = std::tuple<int, Vector, Vector, Matrix, Vector, Vector, Vector, Matrix, double>;

void make(LaneModel* self, std::int64_t ahead, const std::vector<std::int64_t>& checked, bool absolute,
          const std::vector<double>& weights, const std::vector<Numbers>& systems) {
    if (systems.empty() || systems.size() > TrackerModel::kRivals || systems.size() != weights.size())
        throw nb::value_error("there must be one or two systems, each with a weight");
    if (ahead < 0 || ahead > kLongest || checked.size() > BiasLengths::kChecks)
        throw nb::value_error("ahead must be 0 to 2^40 samples, and checked must have at most 3 numbers");
    BiasLengths lengths;
    lengths.ahead = ahead;
    for (size_t i = 0; i < checked.size(); ++i) {
        if (checked[i] < 0 || checked[i] > kLongest)
            throw nb::value_error("the numbers in checked must be 0 to 2^40 samples");
        lengths.checked[i] = checked[i];
    }
    std::vector<Noise> of;
    for (const Numbers& one : systems) of.push_back(std::apply(system_of, one));
    for (size_t i = 0; i < of.size(); ++i) {
        if (of[i].n != of.front().n || !(weights[i] >= 0 && weights[i] <= 1))
            throw nb::value_error("the two systems differ in size, or a weight is not a number from 0 to 1");
    }
    std::shared_ptr<TrackerModel> made;
    {
        const nb::gil_scoped_release release;
        made = TrackerModel::made(of, weights, absolute, lengths);
    }
    if (made == nullptr)
        throw nb::value_error("a Kalman filter cannot use this noise model: its numbers are out of range");
    new (self) LaneModel(std::move(made));
}

// A state that is appended to a system, as a tuple of the fields of Coordinate (noise_system.hpp), in order.
using Row = std::tuple<double, double, double, double, double>;

Noise grown(Noise s, const std::vector<Row>& rows) {
    if (static_cast<size_t>(s.n) + rows.size() > static_cast<size_t>(kMost))
        throw nb::value_error("the system has too many state variables");
    for (const auto& [a, q, variance, signal, shared] : rows)
        append(s, Coordinate{a, q, variance, signal, shared});
    check(s);
    return s;
}

// Returns, for each set of states in `rows`, 2 log L of the remembered samples (up to a constant) under the
// system `numbers` with this set of states appended.
std::vector<double> likelihoods(const RememberedLane& self, const Numbers& numbers,
                                const std::vector<std::vector<Row>>& rows) {
    const Noise bare = std::apply(system_of, numbers);
    const nb::gil_scoped_release release;
    std::vector<double> found;
    found.reserve(rows.size());
    for (const std::vector<Row>& one : rows) found.push_back(self.memory().likelihood(grown(bare, one)));
    return found;
}

void rested_of(const Numbers& numbers, std::int64_t samples, Square P) {
    const Noise s = std::apply(system_of, numbers);
    const size_t n = static_cast<size_t>(s.n);
    if (P.shape(0) != n || P.shape(1) != n)
        throw nb::value_error("P must have one row and one column for each state variable");
    if (samples < 1 || samples > kLongest) throw nb::value_error("samples must be 1 to 2^40");
    std::vector<double> found(n * n + 1);
    bool sound;
    {
        const nb::gil_scoped_release release;
        sound = rested(s, samples, found.data());
    }
    if (!sound) throw nb::value_error("the system is singular");
    std::copy(found.begin(), found.end() - 1, P.data());
}

using Sums = std::pair<std::vector<std::vector<double>>, std::vector<double>>;

Sums sums_of(const Numbers& numbers, Vector c, double R, const std::vector<std::int64_t>& counts) {
    const Noise s = std::apply(system_of, numbers);
    if (c.shape(0) != static_cast<size_t>(s.n))
        throw nb::value_error("c must have one number for each state variable");
    for (const std::int64_t count : counts) {
        if (count < 0 || count > kLongest) throw nb::value_error("counts must be 0 to 2^40 samples");
    }
    std::vector<SumAhead> found(counts.size());
    {
        const nb::gil_scoped_release release;
        sums_ahead(s, c.data(), R, counts.data(), static_cast<int>(counts.size()), found.data());
    }
    Sums sums;
    for (const SumAhead& one : found) {
        sums.first.emplace_back(one.row, one.row + s.n);
        sums.second.push_back(one.variance);
    }
    return sums;
}

}  // namespace

void LaneModel::refilter(const RememberedLane& remembered, int to_come) {
    if (to_come < 0 || to_come > Refiltered::kMostToCome)
        throw nb::value_error("to_come is negative or too large");
    const nb::gil_scoped_release release;
    std::unique_ptr<Refiltered> next(
        new Refiltered(model_, remembered.memory(), remembered.steps(), to_come));
    const std::lock_guard<std::mutex> alone(mutex_);
    refiltered_ = std::move(next);
}

void bind_tracker_model(nb::module_& m) {
    m.attr("TRACKER_COORDINATES") = static_cast<int>(kMost);
    nb::class_<RememberedLane>(m, "Remembered")
        .def("likelihoods", &likelihoods, nb::arg("system"), nb::arg("coordinates"))
        .def("of_walks", &RememberedLane::of_walks);
    m.def("rested", &rested_of, nb::arg("system"), nb::arg("samples"), nb::arg("P"));
    m.def("sums_ahead", &sums_of, nb::arg("system"), nb::arg("c"), nb::arg("R"), nb::arg("counts"));
    nb::class_<LaneModel> model(m, "TrackerModel");
    model.def("__init__", &make, nb::arg("ahead"), nb::arg("checked"), nb::arg("absolute"),
              nb::arg("weights"), nb::arg("systems"));
    model.def("refilter", &LaneModel::refilter, nb::arg("remembered"), nb::arg("to_come"));
    model.attr("MOST_TO_COME") = static_cast<int>(Refiltered::kMostToCome);
}
