// Functions shared by those classes of fltea._native that run the estimator engine.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lanes.hpp"

using Rows = nanobind::ndarray<const double, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
using Flags = nanobind::ndarray<const uint8_t, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
using Places = nanobind::ndarray<uint8_t, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
using Results = nanobind::ndarray<double, nanobind::ndim<3>, nanobind::c_contig, nanobind::device::cpu>;
using Counts = nanobind::ndarray<int32_t, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;

// Releases Python's GIL as long as this object exists. For work on few rows, the GIL is not released, because
// it may take long to acquire the GIL again.
class LockGivenAway {
  public:
    explicit LockGivenAway(size_t rows) {
        if (rows >= kManyRows) release_.emplace();
    }

  private:
    static constexpr size_t kManyRows = 64;
    std::optional<nanobind::gil_scoped_release> release_;
};

// Returns the engine's functions for an instruction set. If this processor does not have that instruction
// set, raises ValueError with the list of usable instruction sets.
const fltea::engine::Backend& find_backend(const std::string& instruction_set);

// Builds the shape of an engine (EngineShape) from those arguments with which the constructors of all these
// classes begin. Raises ValueError for arguments that would break memory safety.
fltea::engine::EngineShape shape_of(bool joint, int guard, bool compressed, int accuracy, size_t window,
                                    const Rows& settings);

// Checks the settings of retune(). Raises ValueError unless there is one entry per lane (axis).
const fltea::engine::LaneSettings* settings_of(const Rows& settings, size_t lanes);

// Raises ValueError for numbers beyond ±`largest` and for NaN. Numbers for which `ignored` is set are not
// checked; if `ignored` is null, all are checked. The check comes before any number reaches the memory of the
// filters, where a NaN would stay for the whole length of the memory.
void check_numbers(const char* name, const double* values, size_t rows, size_t lanes, const uint8_t* ignored,
                   double largest);

// Raises ValueError unless the array `out`, for the counts of the guard, has the shape (lanes, causes).
void check_counts(const Counts& out, const fltea::OwnedEngine& engine);

// Converts a vector of bytes to a Python bytes object; data_of() returns the address of such an object's
// bytes.
nanobind::bytes as_bytes(const std::vector<unsigned char>& bytes);
const unsigned char* data_of(const nanobind::bytes& bytes);

// Returns a list of tuples, one for each lane that became invalid: the row at which this happened, the lane,
// and the reason that its supervisor gave (supervisor.hpp), "runaway" or "bound".
nanobind::list as_list(const std::vector<fltea::Lost>& lost);

void bind_engine(nanobind::module_& m);
void bind_lanes(nanobind::module_& m);
void bind_bank(nanobind::module_& m);
void bind_device(nanobind::module_& m);
void bind_allan(nanobind::module_& m);
void bind_lines(nanobind::module_& m);
void bind_mcap(nanobind::module_& m);
void bind_octaves(nanobind::module_& m);
void bind_round(nanobind::module_& m);
void bind_rows(nanobind::module_& m);
void bind_tracker(nanobind::module_& m);
