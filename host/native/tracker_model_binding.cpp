// fltea._native.TrackerModel and fltea._native.Remembered (host/fltea/estimator/tracker.py).
#include "tracker_model_binding.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>
#include <vector>

#include "number_io.hpp"

namespace nb = nanobind;

namespace {

using namespace fltea::track;
using Noise = TrackerModel::Noise;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr std::int64_t kLongest = std::int64_t(1) << 40;

void copy(const Vector& from, double* to, size_t n) {
    if (from.shape(0) != n) throw nb::value_error("the system's columns differ in length");
    for (size_t i = 0; i < n; ++i) to[i] = from.data()[i];
}

void copy(const Matrix& from, double* to, size_t n) {
    if (from.shape(0) != n || from.shape(1) != n)
        throw nb::value_error("the system's matrices differ in size");
    for (size_t i = 0; i < n * n; ++i) to[i] = from.data()[i];
}

Noise system_of(int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state, Vector bias, Matrix P0,
                double R) {
    const size_t n = a.shape(0);
    if (n > static_cast<size_t>(kMost)) throw nb::value_error("the system has too many coordinates");
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
    // What could not be loaded cannot be set.
    std::vector<double> numbers;
    fltea::NumberSaver saver(numbers);
    s.visit(saver);
    fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    s.visit(loader);
    if (!loader.sound()) throw nb::value_error("no filter can work with such a system");
    return s;
}

using Numbers = std::tuple<int, Vector, Vector, Matrix, Vector, Vector, Vector, Matrix, double>;

void make(LaneModel* self, std::int64_t ahead, const std::vector<std::int64_t>& checked, bool absolute,
          const std::vector<double>& weights, const std::vector<Numbers>& systems) {
    if (systems.empty() || systems.size() > TrackerModel::kRivals || systems.size() != weights.size())
        throw nb::value_error("a noise is one system or two, each with a weight");
    if (ahead < 0 || ahead > kLongest || checked.size() > BiasLengths::kChecks)
        throw nb::value_error("no bias is meant for so many samples");
    BiasLengths lengths;
    lengths.ahead = ahead;
    for (size_t i = 0; i < checked.size(); ++i) {
        if (checked[i] < 0 || checked[i] > kLongest)
            throw nb::value_error("no bias is checked over so many samples");
        lengths.checked[i] = checked[i];
    }
    std::vector<Noise> of;
    for (const Numbers& one : systems) of.push_back(std::apply(system_of, one));
    for (size_t i = 0; i < of.size(); ++i) {
        if (of[i].n != of.front().n || !(weights[i] >= 0 && weights[i] <= 1))
            throw nb::value_error("systems of one noise differ in size, or a weight is none");
    }
    std::shared_ptr<TrackerModel> made;
    {
        const nb::gil_scoped_release release;
        made = TrackerModel::made(of, weights, absolute, lengths);
    }
    if (made == nullptr) throw nb::value_error("no filter can work with such a system");
    new (self) LaneModel(std::move(made));
}

double likelihood(const RememberedLane& self, int pairs, Vector a, Vector b, Matrix Q, Vector c, Vector state,
                  Vector bias, Matrix P0, double R) {
    const Noise system = system_of(pairs, a, b, Q, c, state, bias, P0, R);
    const nb::gil_scoped_release release;
    return self.memory().likelihood(system);
}

}  // namespace

void LaneModel::refilter(const RememberedLane& remembered, int to_come) {
    if (to_come < 0 || to_come > Refiltered::kMostToCome)
        throw nb::value_error("nothing can be filtered before so many samples");
    const nb::gil_scoped_release release;
    std::unique_ptr<Refiltered> next(
        new Refiltered(model_, remembered.memory(), remembered.steps(), to_come));
    const std::lock_guard<std::mutex> alone(mutex_);
    refiltered_ = std::move(next);
}

void bind_tracker_model(nb::module_& m) {
    m.attr("TRACKER_COORDINATES") = static_cast<int>(kMost);
    nb::class_<RememberedLane>(m, "Remembered")
        .def("likelihood", &likelihood)
        .def("of_walks", &RememberedLane::of_walks);
    nb::class_<LaneModel> model(m, "TrackerModel");
    model.def("__init__", &make, nb::arg("ahead"), nb::arg("checked"), nb::arg("absolute"),
              nb::arg("weights"), nb::arg("systems"));
    model.def("refilter", &LaneModel::refilter, nb::arg("remembered"), nb::arg("to_come"));
    model.attr("MOST_TO_COME") = static_cast<int>(Refiltered::kMostToCome);
}
