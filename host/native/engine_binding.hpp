// What the classes of fltea._native that run the engine have in common.
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

// Gives Python's lock away for work on many rows only: who does may wait long until he has it again.
class LockGivenAway {
  public:
    explicit LockGivenAway(size_t rows) {
        if (rows >= kManyRows) release_.emplace();
    }

  private:
    static constexpr size_t kManyRows = 64;
    std::optional<nanobind::gil_scoped_release> release_;
};

// ValueError, with those that are, if the set is not usable here.
const fltea::engine::Backend& find_backend(const std::string& instruction_set);

// Of the arguments that all such classes begin with; ValueError for those that would break memory safety.
fltea::engine::EngineShape shape_of(bool joint, int guard, bool compressed, int accuracy, size_t window,
                                    const Rows& settings);

// For retune(): ValueError unless they are as many as there are lanes.
const fltea::engine::LaneSettings* settings_of(const Rows& settings, size_t lanes);

// Before anything reaches the memory, where a NaN would stay for a whole window: ValueError for numbers
// beyond ±largest. Those that are `ignored` (null: none) may be anything.
void check_numbers(const char* name, const double* values, size_t rows, size_t lanes, const uint8_t* ignored,
                   double largest);

// ValueError unless the array is (lanes, causes).
void check_counts(const Counts& out, const fltea::OwnedEngine& engine);

// As Python's bytes and back.
nanobind::bytes as_bytes(const std::vector<unsigned char>& bytes);
const unsigned char* data_of(const nanobind::bytes& bytes);

// (row, lane, "runaway" or "bound") of each.
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
