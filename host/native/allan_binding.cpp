// Makes the C++ class AllanSums available in Python as fltea._native.AllanSums. The class computes the Allan
// variance of one axis. Samples come as numpy arrays.
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <tuple>

#include "allan_sums.hpp"
#include "engine_binding.hpp"

namespace nb = nanobind;

namespace {

using fltea::AllanSums;
using Numbers = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Columns = std::tuple<std::vector<double>, std::vector<double>, std::vector<double>>;

void add(AllanSums& sums, Numbers y) {
    check_numbers("y", y.data(), y.shape(0), 1, nullptr, fltea::allan::kLargestValue);
    sums.add(y.data(), y.shape(0));
}

Columns points(const AllanSums& sums) {
    Columns result;
    for (const fltea::allan::Point& point : sums.points()) {
        std::get<0>(result).push_back(point.factor);
        std::get<1>(result).push_back(point.avar);
        std::get<2>(result).push_back(point.terms);
    }
    return result;
}

nb::bytes save(const AllanSums& sums) {
    const std::vector<double> numbers = sums.save();
    return nb::bytes(numbers.data(), numbers.size() * sizeof(double));
}

void load(AllanSums& sums, const nb::bytes& bytes) {
    std::vector<double> numbers(bytes.size() / sizeof(double));
    if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
    if (bytes.size() % sizeof(double) != 0 || !sums.load(numbers.data(), numbers.size())) {
        throw nb::value_error("the saved sums of the Allan variance cannot be read");
    }
}

}  // namespace

void bind_allan(nb::module_& m) {
    nb::class_<AllanSums>(m, "AllanSums")
        .def(nb::init<double>(), nb::arg("memory_samples") = 0.0)
        .def("add", &add, nb::arg("y"))
        .def(
            "cut", [](AllanSums& sums, unsigned long long lost) { sums.cut(static_cast<double>(lost)); },
            nb::arg("lost") = 0)
        .def("merge", &AllanSums::merge, nb::arg("other"))
        .def("points", &points)
        .def_prop_ro("samples", &AllanSums::samples)
        .def_prop_ro("span", &AllanSums::span)
        .def("save", &save)
        .def("load", &load, nb::arg("bytes"));
}
