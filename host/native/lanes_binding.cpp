// Makes the C++ class LaneRunner available in Python as fltea._native.Lanes (host/fltea/estimator/lanes.py).
// The class runs lanes of the engine under supervisors. Samples and estimates are numpy arrays.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <mutex>
#include <optional>

#include "engine_binding.hpp"

namespace nb = nanobind;

namespace {

using fltea::LaneRunner;
using fltea::Lost;
using fltea::engine::LaneSettings;

class Lanes {
  public:
    Lanes(const std::string& instruction_set, bool joint, int guard, bool compressed, int accuracy,
          size_t window, Rows settings)
        : lanes_(find_backend(instruction_set),
                 shape_of(joint, guard, compressed, accuracy, window, settings),
                 reinterpret_cast<const LaneSettings*>(settings.data())) {}

    // Processes rows of samples; a row has a value for each lane (axis). `out` has the shape (columns, rows,
    // lanes), and `valid` has the shape (rows, lanes).
    nb::list run(Rows y, std::optional<Flags> missing, Results out,
                 nb::ndarray<uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu> valid) {
        const size_t rows = y.shape(0), lanes = lanes_.lanes();
        const auto fits = [&](size_t n, size_t width) { return n == rows && width == lanes; };
        if (y.shape(1) != lanes || (missing && !fits(missing->shape(0), missing->shape(1))) ||
            !fits(valid.shape(0), valid.shape(1)) || out.shape(0) != fltea::kLaneColumns ||
            !fits(out.shape(1), out.shape(2))) {
            throw nb::value_error(
                "y, missing and valid must have shape (rows, lanes), out (columns, rows, lanes)");
        }
        const uint8_t* const gone = missing ? missing->data() : nullptr;
        check_numbers("y", y.data(), rows, lanes, gone, fltea::kLargestInput);
        double* columns[fltea::kLaneColumns];
        for (size_t i = 0; i < fltea::kLaneColumns; ++i) columns[i] = out.data() + i * rows * lanes;
        std::vector<Lost> lost;
        {
            const LockGivenAway given(rows);
            const std::lock_guard<std::mutex> alone(mutex_);
            lanes_.run(y.data(), gone, rows, columns, valid.data(), lost);
        }
        return as_list(lost);
    }

    std::vector<uint64_t> restarts() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return lanes_.restarts();
    }

    void counts(Counts out) const {
        check_counts(out, lanes_.engine());
        const std::lock_guard<std::mutex> alone(mutex_);
        lanes_.counts(out.data());
    }

  private:
    LaneRunner lanes_;
    mutable std::mutex mutex_;
};

}  // namespace

void bind_lanes(nb::module_& m) {
    m.attr("LOST_ORDER") = static_cast<double>(fltea::engine::kLostOrder);
    m.attr("BOUND_SAMPLES") = fltea::engine::kBoundSamples;
    m.attr("BOUND_MOST") = fltea::engine::kBoundMost;
    nb::class_<Lanes>(m, "Lanes")
        .def(nb::init<const std::string&, bool, int, bool, int, size_t, Rows>(), nb::arg("instruction_set"),
             nb::arg("joint"), nb::arg("guard"), nb::arg("compressed"), nb::arg("accuracy"),
             nb::arg("window"), nb::arg("settings"))
        .def("run", &Lanes::run, nb::arg("y"), nb::arg("missing").none(), nb::arg("out"), nb::arg("valid"))
        .def("restarts", &Lanes::restarts)
        .def("counts", &Lanes::counts, nb::arg("out"));
}
