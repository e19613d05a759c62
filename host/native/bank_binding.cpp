// Makes the C++ class AxisBank available in Python as fltea._native.Bank (host/fltea/estimator/bank.py). The
// class filters all axes of a sensor. Samples and results are numpy arrays.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstring>
#include <mutex>
#include <optional>
#include <tuple>

#include "axis_bank.hpp"
#include "engine_binding.hpp"
#include "number_io.hpp"
#include "sensor.hpp"

namespace nb = nanobind;

namespace {

using fltea::AxisBank;
using fltea::LaneRunner;
using fltea::Lost;
using fltea::engine::LaneSettings;
using Numbers = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Mask = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Largest number of lost samples for which skip() can be called. There is a limit because the filters predict
// lost samples one by one.
constexpr size_t kMostSkipped = 10'000'000;

// Statistics of a start-up window: the mean of its values, their variance, and whether all values are equal.
// The variance is at least that of the error of rounding to `resolution`.
using Moments = std::tuple<double, double, bool>;

Moments moments_of(const fltea::engine::Baseline<double>& window, double resolution) {
    return {window.bias(), window.variance(resolution), window.constant()};
}

// Returns the statistics of a start-up window for every column of an array; a column has the values of one
// axis.
std::vector<Moments> moments(Rows y, double resolution) {
    const size_t columns = y.shape(1);
    std::vector<fltea::engine::Baseline<double>> windows(columns);
    for (size_t i = 0; i < y.size(); ++i) windows[i % columns].add(y.data()[i]);
    std::vector<Moments> result;
    for (const auto& window : windows) result.push_back(moments_of(window, resolution));
    return result;
}

class Bank : public fltea::BankPart {
  public:
    explicit Bank(size_t axes) : bank_(checked(axes)) {}

    // Processes rows. `out` has the shape (kLaneColumns, rows, axes); `valid` and `white` have the shape
    // (rows, axes).
    nb::list run(Rows y, Results out, Places valid, Places white) {
        const size_t rows = y.shape(0), axes = bank_.axes();
        const size_t columns = fltea::kLaneColumns;
        if (y.shape(1) != axes || out.shape(0) != columns || out.shape(1) != rows || out.shape(2) != axes ||
            valid.shape(0) != rows || valid.shape(1) != axes || white.shape(0) != rows ||
            white.shape(1) != axes) {
            throw nb::value_error(
                "y, valid and white must have shape (rows, axes), out (columns, rows, axes)");
        }
        check_numbers("y", y.data(), rows, axes, nullptr, fltea::kLargestSample);
        fltea::BankBlock block;
        for (size_t i = 0; i < columns; ++i) block.columns[i] = out.data() + i * rows * axes;
        block.valid = valid.data();
        block.white = white.data();
        std::vector<Lost> lost;
        {
            const LockGivenAway given(rows);
            run(y.data(), rows, block, lost);
        }
        return as_list(lost);
    }

    void run(const double* y, size_t rows, const fltea::BankBlock& out, std::vector<Lost>& lost) override {
        const std::lock_guard<std::mutex> alone(mutex_);
        bank_.run(y, rows, out, lost);
    }

    nb::list skip(size_t count) {
        if (count > kMostSkipped) throw nb::value_error("at most 10,000,000 lost samples can be skipped");
        std::vector<Lost> lost;
        {
            nb::gil_scoped_release release;
            skip_rows(count, lost);
        }
        return as_list(lost);
    }

    void skip_rows(uint64_t count, std::vector<Lost>& lost) override {
        const std::lock_guard<std::mutex> alone(mutex_);
        bank_.skip(count, lost);
    }

    std::vector<Moments> window(double resolution) const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<Moments> result;
        for (size_t axis = 0; axis < bank_.axes(); ++axis) {
            result.push_back(moments_of(bank_.window(axis), resolution));
        }
        return result;
    }

    void start(const std::string& instruction_set, bool joint, int guard, bool compressed, int accuracy,
               size_t window, Rows settings, Numbers bias, Mask live) {
        const std::lock_guard<std::mutex> alone(mutex_);
        const size_t axes = bank_.axes();
        if (settings.shape(0) != axes || bias.shape(0) != axes || live.shape(0) != axes) {
            throw nb::value_error("settings, bias and live must have one entry for each axis");
        }
        for (size_t axis = 0; axis < axes; ++axis) {
            if (!(std::fabs(bias.data()[axis]) <= fltea::kLargestSample)) {
                throw nb::value_error("a bias must be finite and within 5e99");
            }
        }
        bank_.start(
            std::make_unique<LaneRunner>(find_backend(instruction_set),
                                         shape_of(joint, guard, compressed, accuracy, window, settings),
                                         reinterpret_cast<const LaneSettings*>(settings.data())),
            bias.data(), live.data());
    }

    void retune(Rows settings) {
        const LaneSettings* const table = settings_of(settings, bank_.axes());
        const std::lock_guard<std::mutex> alone(mutex_);
        lanes().retune(table);
    }

    void set_filter_model(size_t axis, double alpha, double parameter, double alpha_variance,
                          double covariance, double parameter_variance) {
        const fltea::engine::FilterModel filter_model = {alpha, parameter, alpha_variance, covariance,
                                                         parameter_variance};
        const double all = alpha + parameter + alpha_variance + covariance + parameter_variance;
        const std::lock_guard<std::mutex> alone(mutex_);
        if (axis >= bank_.axes() || !std::isfinite(all) || alpha < 0 || alpha > 2 || alpha_variance < 0 ||
            parameter_variance < 0 || covariance * covariance > alpha_variance * parameter_variance) {
            throw nb::value_error("an axis cannot use this filter model");
        }
        lanes().set_filter_model(axis, filter_model);
    }

    // `known`: for each axis, alpha and f of a fit with their standard deviations, or None if there is no
    // fit.
    void know(const std::vector<std::optional<std::tuple<double, double, double, double>>>& known) {
        const std::lock_guard<std::mutex> alone(mutex_);
        if (known.size() != bank_.axes()) throw nb::value_error("known must have one entry for each axis");
        std::vector<fltea::Known> all;
        for (const auto& one : known) {
            all.emplace_back();
            if (one) all.back() = std::apply([](auto... x) { return fltea::Known{true, x...}; }, *one);
        }
        bank_.know(all);
    }

    std::tuple<double, double> newest(size_t axis) const {
        const std::lock_guard<std::mutex> alone(mutex_);
        if (axis >= bank_.axes()) throw nb::index_error("no such axis");
        return {bank_.newest(axis).alpha, bank_.newest(axis).alpha_std};
    }

    std::vector<uint64_t> restarts() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return lanes().restarts();
    }

    void counts(Counts out) const {
        check_counts(out, lanes().engine());
        const std::lock_guard<std::mutex> alone(mutex_);
        lanes().counts(out.data());
    }

    // Returns four figures of the innovations for each axis: the correlation of neighbours (lag 1), NIS (the
    // mean of squared innovations over their predicted variance), the Ljung-Box statistic, and the number of
    // innovations from which that statistic is computed. All these figures are NaN until there are enough
    // innovations.
    std::vector<std::tuple<double, double, double, int>> whiteness() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<std::tuple<double, double, double, int>> result;
        for (size_t axis = 0; axis < bank_.axes(); ++axis) {
            const fltea::Whiteness& one = bank_.whiteness(axis);
            const fltea::Whiteness::LjungBox box = one.ljung_box();
            result.emplace_back(one.lag1(), one.nis(), box.value, box.n);
        }
        return result;
    }

    // Returns the state of the engine, of the supervisors that restart diverged filters, and of the whiteness
    // tests.
    std::tuple<nb::bytes, nb::bytes, nb::bytes> save() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        std::vector<double> numbers;
        fltea::NumberSaver saver(numbers);
        for (fltea::Whiteness& one : bank_.whiteness()) one.visit(saver);
        return {as_bytes(lanes().save()), as_bytes(lanes().save_supervisors()),
                nb::bytes(numbers.data(), numbers.size() * sizeof(double))};
    }

    void load(nb::bytes engine, std::optional<nb::bytes> supervisors, const std::vector<uint64_t>& restarts,
              std::optional<nb::bytes> whiteness) {
        const std::lock_guard<std::mutex> alone(mutex_);
        if (whiteness) load_whiteness(*whiteness);
        if (restarts.size() != bank_.axes())
            throw nb::value_error("restarts must have one entry for each axis");
        if (!lanes().load(data_of(engine), engine.size())) {
            throw nb::value_error("the saved numbers cannot come from an engine of this kind");
        }
        if (supervisors && !lanes().load_supervisors(data_of(*supervisors), supervisors->size())) {
            throw nb::value_error("the saved state of the supervisors cannot be read");
        }
        lanes().set_restarts(restarts);
    }

  private:
    void load_whiteness(const nb::bytes& bytes) {
        std::vector<double> numbers(bytes.size() / sizeof(double));
        if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
        std::vector<fltea::Whiteness> loaded(bank_.axes());
        fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
        for (fltea::Whiteness& one : loaded) one.visit(loader);
        if (!loader.sound() || !loader.at_end() || bytes.size() % sizeof(double) != 0) {
            throw nb::value_error("the saved statistics of the innovations cannot be read");
        }
        bank_.whiteness() = loaded;
    }

    static size_t checked(size_t axes) {
        if (axes == 0) throw nb::value_error("a bank has at least one axis");
        return axes;
    }

    LaneRunner& lanes() const {
        if (!bank_.started()) throw nb::value_error("the start-up window is not full");
        return *bank_.lanes();
    }

    mutable AxisBank bank_;
    mutable std::mutex mutex_;
};

}  // namespace

void bind_bank(nb::module_& m) {
    m.attr("LARGEST_OFFSET") = fltea::kLargestSample;
    m.def("moments", &moments, nb::arg("y"), nb::arg("resolution"));
    nb::class_<Bank, fltea::BankPart>(m, "Bank")
        .def(nb::init<size_t>(), nb::arg("axes"))
        .def("run", nb::overload_cast<Rows, Results, Places, Places>(&Bank::run), nb::arg("y"),
             nb::arg("out"), nb::arg("valid"), nb::arg("white"))
        .def("skip", &Bank::skip, nb::arg("count"))
        .def("window", &Bank::window, nb::arg("resolution"))
        .def("start", &Bank::start, nb::arg("instruction_set"), nb::arg("joint"), nb::arg("guard"),
             nb::arg("compressed"), nb::arg("accuracy"), nb::arg("window"), nb::arg("settings"),
             nb::arg("bias"), nb::arg("live"))
        .def("retune", &Bank::retune, nb::arg("settings"))
        .def("set_filter_model", &Bank::set_filter_model, nb::arg("axis"), nb::arg("alpha"),
             nb::arg("parameter"), nb::arg("alpha_variance"), nb::arg("covariance"),
             nb::arg("parameter_variance"))
        .def("know", &Bank::know, nb::arg("known"))
        .def("newest", &Bank::newest, nb::arg("axis"))
        .def("restarts", &Bank::restarts)
        .def("counts", &Bank::counts, nb::arg("out"))
        .def("whiteness", &Bank::whiteness)
        .def("save", &Bank::save)
        .def("load", &Bank::load, nb::arg("engine"), nb::arg("supervisors").none(), nb::arg("restarts"),
             nb::arg("whiteness").none());
}
