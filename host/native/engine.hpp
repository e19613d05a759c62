// Interface between the engine and its binding: plain data, and one table of functions per instruction set.
//
// engine.cpp is compiled once per instruction set, and each compilation fills one table. This file contains
// no code, so that the linker cannot put a function compiled for one set into another. The caller owns all
// memory.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fltea {

// Larger inputs would overflow a double when they are squared and summed over thousands of samples.
constexpr double kLargestInput = 1e100;

namespace engine {

// Settings that all lanes of an engine share. Enumerations are stored as numbers, because their types belong
// to the namespaces of the instruction sets.
struct EngineShape {
    std::size_t lanes;
    std::int32_t joint;       // 0: triple (three filters), 1: joint (filters.hpp, joint.hpp)
    std::int32_t guard;       // enum Guard of guard.hpp
    std::int32_t compressed;  // 0: direct memory, 1: compressed
    std::int32_t accuracy;    // compressed: digits of compressed_config(), 0 is its default
    std::size_t window;       // L in samples; 0, with compressed memory only: unlimited
};

// Settings of one lane: the fields of Tuning (filters.hpp), in the same order.
struct LaneSettings {
    double log_h;
    double x0, P0, Q, R;
    double alpha0, order_P0, order_Q0, order_R, order_delta;
    double f0, parameter_P0, parameter_Q0, parameter_R, parameter_delta;
    double gate;
};

// Estimate from which a lane continues: means and variances of the order and of the parameter (f of `triple`,
// beta of `joint`), and, for `joint` only, their covariance.
struct FilterModel {
    double alpha, parameter;
    double alpha_variance, covariance, parameter_variance;
};

// Columns of an estimate.
enum Column : int {
    kAlpha,
    kAlphaVariance,
    kF,
    kFVariance,
    kX,
    kP,
    kInnovation,
    kInnovationVariance,
    kColumns
};

// A block of `samples` rows with `lanes` numbers each, stored row by row. `u` may be null (no input), and so
// may `missing` (no sample is missing). All numbers are finite.
struct Block {
    std::size_t samples;
    const double* y;
    const double* u;
    const std::uint8_t* missing;
    double* out[kColumns];
};

// Extra arguments of a run under the supervisor (supervisor.hpp). A lane that the supervisor declares lost
// restarts at the next row, together with its supervisor. In the block's columns, standard deviations replace
// the variances, kP is not written, and all columns are NaN where a lane is not valid.
struct Watch {
    unsigned char* supervisors;  // Backend::supervisor bytes per lane; all zeros: a new supervisor
    std::uint8_t* verdicts;      // (samples, lanes): VerdictBits
};

enum VerdictBits : int { kValid = 1, kRestarted = 2, kRanAway = 4, kBound = 8 };

struct Backend {
    const char* name;
    int width;               // lanes in a pack
    int causes;              // counters per lane
    std::size_t supervisor;  // bytes of one supervisor

    // Returns the number of bytes of storage, aligned to 64, that an engine of this shape needs.
    std::size_t (*storage)(const EngineShape& shape);
    // Builds an engine in `storage`. `settings` has one entry per lane.
    void (*start)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // Applies other settings from the next sample on, one entry per lane. The state and memory of the lanes
    // stay.
    void (*retune)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // Replaces the estimated order and parameter of one lane. Its state and its memory stay.
    void (*set_filter_model)(void* storage, const EngineShape& shape, std::size_t lane,
                             const FilterModel& filter_model);
    void (*run)(void* storage, const EngineShape& shape, const Block& block);
    void (*watch)(void* storage, const EngineShape& shape, const Block& block, const Watch& watch);
    // Restarts the lanes whose mask is not 0.
    void (*reset)(void* storage, const EngineShape& shape, const std::uint8_t* mask);
    // Writes the counters (lanes, causes), row by row.
    void (*counts)(const void* storage, const EngineShape& shape, std::int32_t* out);
    // Returns the size of a snapshot; `save` writes the snapshot. The settings are not part of a snapshot.
    std::size_t (*snapshot)(const EngineShape& shape);
    void (*save)(const void* storage, const EngineShape& shape, unsigned char* out);
    // Returns false if the snapshot cannot come from an engine of this shape, or has impossible numbers. Part
    // of it may be loaded by then, so the engine has to be discarded or restarted.
    bool (*load)(void* storage, const EngineShape& shape, const unsigned char* in);
};

extern const Backend engine_baseline;
extern const Backend engine_avx2;
extern const Backend engine_avx512;

}  // namespace engine
}  // namespace fltea
