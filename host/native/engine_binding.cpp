// Makes the estimator engine available in Python as fltea._native.Engine. Samples and estimates are float64
// arrays.
//
// Python code should use host/fltea/estimator/engine.py, whose class checks the settings. This binding only
// rejects arguments that would break memory safety or corrupt an estimator.
#include "engine_binding.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <mutex>
#include <optional>

namespace nb = nanobind;

using fltea::engine::Backend;
using fltea::engine::Block;
using fltea::engine::EngineShape;
using fltea::engine::LaneSettings;

namespace {

// The function tables of the engine for those instruction sets that this processor has, fastest first.
std::vector<const Backend*> usable() {
    std::vector<const Backend*> result;
#if defined(FLTEA_X86)
    __builtin_cpu_init();
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) {
        result.push_back(&fltea::engine::engine_avx512);
    }
    if (avx2) result.push_back(&fltea::engine::engine_avx2);
#endif
    result.push_back(&fltea::engine::engine_baseline);
    return result;
}

}  // namespace

const Backend& find_backend(const std::string& name) {
    std::string known;
    for (const Backend* backend : usable()) {
        if (name == backend->name) return *backend;
        known += (known.empty() ? "" : ", ") + std::string(backend->name);
    }
    throw nb::value_error(("instruction set '" + name + "' is not usable here; usable: " + known).c_str());
}

EngineShape shape_of(bool joint, int guard, bool compressed, int accuracy, size_t window,
                     const Rows& settings) {
    if (settings.shape(0) == 0 || settings.shape(1) * sizeof(double) != sizeof(LaneSettings)) {
        throw nb::value_error("settings must have one row for each lane and one column for each field");
    }
    if (guard < 0 || guard > 2 || (window == 0 && !compressed))
        throw nb::value_error("guard must be 0, 1 or 2, and window above 0 unless the memory is compressed");
    return EngineShape{settings.shape(0), joint, guard, compressed, accuracy, window};
}

const LaneSettings* settings_of(const Rows& settings, size_t lanes) {
    if (settings.shape(0) != lanes || settings.shape(1) * sizeof(double) != sizeof(LaneSettings)) {
        throw nb::value_error("settings must have one row for each lane and one column for each field");
    }
    return reinterpret_cast<const LaneSettings*>(settings.data());
}

void check_numbers(const char* name, const double* values, size_t rows, size_t lanes, const uint8_t* ignored,
                   double largest) {
    for (size_t i = 0; i < rows * lanes; ++i) {
        if (std::fabs(values[i]) <= largest || (ignored && ignored[i])) continue;
        throw nb::value_error((std::string(name) + "[" + std::to_string(i / lanes) + "], lane " +
                               std::to_string(i % lanes) + " is " + std::to_string(values[i]) +
                               ": it must be finite and within 1e100; a sample that was lost is `missing`")
                                  .c_str());
    }
}

void check_counts(const Counts& out, const fltea::OwnedEngine& engine) {
    if (out.shape(0) != engine.lanes() || out.shape(1) != engine.causes()) {
        throw nb::value_error("out must have shape (lanes, causes)");
    }
}

nb::bytes as_bytes(const std::vector<unsigned char>& bytes) { return nb::bytes(bytes.data(), bytes.size()); }

const unsigned char* data_of(const nb::bytes& bytes) {
    return static_cast<const unsigned char*>(bytes.data());
}

nb::list as_list(const std::vector<fltea::Lost>& lost) {
    nb::list result;
    for (const fltea::Lost& one : lost) {
        const bool runaway = one.reason == fltea::engine::Loss::runaway;
        result.append(nb::make_tuple(one.row, one.lane, runaway ? "runaway" : "bound"));
    }
    return result;
}

namespace {

class Engine {
  public:
    Engine(const std::string& instruction_set, bool joint, int guard, bool compressed, int accuracy,
           size_t window, Rows settings)
        : engine_(find_backend(instruction_set),
                  shape_of(joint, guard, compressed, accuracy, window, settings),
                  reinterpret_cast<const LaneSettings*>(settings.data())) {}

    // Runs a block of samples. `out` has the shape (columns, samples, lanes); a lane is one axis.
    void run(Rows y, std::optional<Rows> u, std::optional<Flags> missing, Results out) {
        Block block = Block();
        block.samples = y.shape(0);
        block.y = y.data();
        check(y.shape(1), "y");
        if (u) {
            if (u->shape(0) != block.samples) throw nb::value_error("u must have as many samples as y");
            check(u->shape(1), "u");
            block.u = u->data();
        }
        if (missing) {
            if (missing->shape(0) != block.samples)
                throw nb::value_error("missing must have as many samples as y");
            check(missing->shape(1), "missing");
            block.missing = missing->data();
        }
        if (out.shape(0) != fltea::engine::kColumns || out.shape(1) != block.samples ||
            out.shape(2) != engine_.lanes()) {
            throw nb::value_error("out must have shape (columns, samples, lanes)");
        }
        for (int column = 0; column < fltea::engine::kColumns; ++column) {
            block.out[column] = out.data() + static_cast<size_t>(column) * block.samples * engine_.lanes();
        }
        check_numbers("y", block.y, block.samples, engine_.lanes(), block.missing, fltea::kLargestInput);
        if (block.u)
            check_numbers("u", block.u, block.samples, engine_.lanes(), nullptr, fltea::kLargestInput);
        nb::gil_scoped_release release;
        const std::lock_guard<std::mutex> alone(mutex_);
        engine_.run(block);
    }

    void retune(Rows settings) {
        const LaneSettings* const table = settings_of(settings, engine_.lanes());
        const std::lock_guard<std::mutex> alone(mutex_);
        engine_.retune(table);
    }

    void reset(nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> mask) {
        if (mask.shape(0) != engine_.lanes()) throw nb::value_error("mask must have one entry for each lane");
        const std::lock_guard<std::mutex> alone(mutex_);
        engine_.reset(mask.data());
    }

    void counts(Counts out) const {
        check_counts(out, engine_);
        const std::lock_guard<std::mutex> alone(mutex_);
        engine_.counts(out.data());
    }

    size_t bytes() const { return engine_.bytes(); }

  private:
    void check(size_t lanes, const char* name) const {
        if (lanes != engine_.lanes()) {
            throw nb::value_error((std::string(name) + " must have " + std::to_string(engine_.lanes()) +
                                   " lanes, got " + std::to_string(lanes))
                                      .c_str());
        }
    }

    fltea::OwnedEngine engine_;
    mutable std::mutex mutex_;
};

}  // namespace

void bind_engine(nb::module_& m) {
    m.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const Backend* backend : usable()) names.emplace_back(backend->name);
        return names;
    });
    m.attr("LARGEST_INPUT") = fltea::kLargestInput;
    nb::class_<Engine>(m, "Engine")
        .def(nb::init<const std::string&, bool, int, bool, int, size_t, Rows>(), nb::arg("instruction_set"),
             nb::arg("joint"), nb::arg("guard"), nb::arg("compressed"), nb::arg("accuracy"),
             nb::arg("window"), nb::arg("settings"))
        .def("run", &Engine::run, nb::arg("y"), nb::arg("u").none(), nb::arg("missing").none(),
             nb::arg("out"))
        .def("retune", &Engine::retune, nb::arg("settings"))
        .def("reset", &Engine::reset, nb::arg("mask"))
        .def("counts", &Engine::counts, nb::arg("out"))
        .def_prop_ro("storage_bytes", &Engine::bytes);
}
