// fltea._native.Engine: the estimator engine for Python, on plain float64 arrays.
//
// host/fltea/estimator/engine.py is the interface for people and checks settings; here only what would break
// memory safety or poison an estimator is refused.
#include "engine_binding.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "engine.hpp"

namespace nb = nanobind;

namespace {

using fltea::engine::Backend;
using fltea::engine::Block;
using fltea::engine::EngineShape;
using fltea::engine::LaneSettings;

// Squares of larger numbers, and sums of thousands of them, would leave the range of doubles.
constexpr double kLargestInput = 1e100;

// Tables that this processor can run, best first.
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

const Backend& find(const std::string& name) {
    std::string known;
    for (const Backend* backend : usable()) {
        if (name == backend->name) return *backend;
        known += (known.empty() ? "" : ", ") + std::string(backend->name);
    }
    throw nb::value_error(("instruction set '" + name + "' is not usable here; usable: " + known).c_str());
}

using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Results = nb::ndarray<double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

struct Free {
    void operator()(void* storage) const { ::operator delete(storage, std::align_val_t(64)); }
};

class Engine {
  public:
    Engine(const std::string& instruction_set, bool joint, int guard, bool compressed, int accuracy,
           size_t window, Rows settings)
        : backend_(find(instruction_set)) {
        if (settings.shape(0) == 0 || settings.shape(1) * sizeof(double) != sizeof(LaneSettings)) {
            throw nb::value_error("settings must have one row a lane and one column a field");
        }
        if (guard < 0 || guard > 2 || (window == 0 && !compressed)) throw nb::value_error("no such engine");
        shape_ = EngineShape{settings.shape(0), joint, guard, compressed, accuracy, window};
        storage_.reset(::operator new(backend_.storage(shape_), std::align_val_t(64)));
        // Gaps between the parts of it get into snapshots, which are to be repeatable.
        std::memset(storage_.get(), 0, backend_.storage(shape_));
        backend_.start(storage_.get(), shape_, reinterpret_cast<const LaneSettings*>(settings.data()));
    }

    // out: (columns, samples, lanes).
    void run(Rows y, std::optional<Rows> u, std::optional<Flags> missing, Results out) {
        Block block = Block();
        block.samples = y.shape(0);
        block.y = y.data();
        check(y.shape(0), y.shape(1), "y");
        if (u) {
            if (u->shape(0) != block.samples) throw nb::value_error("u must have as many samples as y");
            check(u->shape(0), u->shape(1), "u");
            block.u = u->data();
        }
        if (missing) {
            if (missing->shape(0) != block.samples)
                throw nb::value_error("missing must have as many samples as y");
            check(missing->shape(0), missing->shape(1), "missing");
            block.missing = missing->data();
        }
        if (out.shape(0) != fltea::engine::kColumns || out.shape(1) != block.samples ||
            out.shape(2) != shape_.lanes) {
            throw nb::value_error("out must have shape (columns, samples, lanes)");
        }
        for (int column = 0; column < fltea::engine::kColumns; ++column) {
            block.out[column] = out.data() + static_cast<size_t>(column) * block.samples * shape_.lanes;
        }
        check_numbers("y", block.y, block, block.missing);
        if (block.u) check_numbers("u", block.u, block, nullptr);
        nb::gil_scoped_release release;
        const std::lock_guard<std::mutex> alone(mutex_);
        backend_.run(storage_.get(), shape_, block);
    }

    void reset(nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> mask) {
        if (mask.shape(0) != shape_.lanes) throw nb::value_error("mask must have one entry a lane");
        const std::lock_guard<std::mutex> alone(mutex_);
        backend_.reset(storage_.get(), shape_, mask.data());
    }

    void counts(nb::ndarray<int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu> out) const {
        if (out.shape(0) != shape_.lanes || out.shape(1) != static_cast<size_t>(backend_.causes)) {
            throw nb::value_error("out must have shape (lanes, causes)");
        }
        const std::lock_guard<std::mutex> alone(mutex_);
        backend_.counts(storage_.get(), shape_, out.data());
    }

    nb::bytes save() const {
        std::vector<unsigned char> bytes(backend_.snapshot(shape_));
        const std::lock_guard<std::mutex> alone(mutex_);
        backend_.save(storage_.get(), shape_, bytes.data());
        return nb::bytes(bytes.data(), bytes.size());
    }

    void load(nb::bytes bytes) {
        if (bytes.size() != backend_.snapshot(shape_)) throw nb::value_error("the snapshot has a wrong size");
        const std::lock_guard<std::mutex> alone(mutex_);
        if (!backend_.load(storage_.get(), shape_, static_cast<const unsigned char*>(bytes.data()))) {
            throw nb::value_error("the snapshot is damaged");
        }
    }

    size_t bytes() const { return backend_.storage(shape_); }

  private:
    void check(size_t, size_t lanes, const char* name) const {
        if (lanes != shape_.lanes) {
            throw nb::value_error((std::string(name) + " must have " + std::to_string(shape_.lanes) +
                                   " lanes, got " + std::to_string(lanes))
                                      .c_str());
        }
    }

    // Before anything reaches the memory, where a NaN would stay for a whole window.
    void check_numbers(const char* name, const double* values, const Block& block,
                       const uint8_t* ignored) const {
        const size_t n = block.samples * shape_.lanes;
        for (size_t i = 0; i < n; ++i) {
            if (std::fabs(values[i]) <= kLargestInput || (ignored && ignored[i])) continue;
            throw nb::value_error(
                (std::string(name) + "[" + std::to_string(i / shape_.lanes) + "], lane " +
                 std::to_string(i % shape_.lanes) + " is " + std::to_string(values[i]) +
                 ": it must be finite and within 1e100; a sample that was lost is `missing`")
                    .c_str());
        }
    }

    const Backend& backend_;
    EngineShape shape_;
    std::unique_ptr<void, Free> storage_;
    mutable std::mutex mutex_;
};

}  // namespace

void bind_engine(nb::module_& m) {
    m.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const Backend* backend : usable()) names.emplace_back(backend->name);
        return names;
    });
    m.attr("LARGEST_INPUT") = kLargestInput;
    nb::class_<Engine>(m, "Engine")
        .def(nb::init<const std::string&, bool, int, bool, int, size_t, Rows>(), nb::arg("instruction_set"),
             nb::arg("joint"), nb::arg("guard"), nb::arg("compressed"), nb::arg("accuracy"),
             nb::arg("window"), nb::arg("settings"))
        .def("run", &Engine::run, nb::arg("y"), nb::arg("u").none(), nb::arg("missing").none(),
             nb::arg("out"))
        .def("reset", &Engine::reset, nb::arg("mask"))
        .def("counts", &Engine::counts, nb::arg("out"))
        .def("save", &Engine::save)
        .def("load", &Engine::load, nb::arg("snapshot"))
        .def_prop_ro("storage_bytes", &Engine::bytes);
}
