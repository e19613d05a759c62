// Interface between the estimator engine and the code that uses it. It consists of plain data, and of one
// table of functions for each instruction set.
//
// engine.cpp is compiled once per instruction set, and each compilation fills one table. This file contains
// no functions: the linker might use a function that was compiled for one instruction set in the code for
// another one. The caller owns all memory.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fltea {

// Largest magnitude of an input of the engine. Larger inputs would overflow a double when their squares are
// summed over thousands of samples.
constexpr double kLargestInput = 1e100;

namespace engine {

// Settings that all lanes of an engine share; a lane is one axis. Values of enumerations are stored as
// integers, because the enumeration types belong to the namespaces of the instruction sets.
struct EngineShape {
    std::size_t lanes;
    std::int32_t joint;  // 0: triple (three filters), 1: joint (filters.hpp, joint.hpp)
    std::int32_t guard;  // which guard limits the estimates: a value of enum Guard (guard.hpp)
    // kind of memory of past states: 0: direct, with all of them (memory_direct.hpp); 1: compressed to
    // decaying sums
    std::int32_t compressed;
    // accuracy of the compressed memory, as the argument `digits` of compressed_config(); 0 stands for the
    // default
    std::int32_t accuracy;
    // length L of the memory in samples; 0 means unlimited, which only the compressed memory allows
    std::size_t window;
};

// Settings of one lane (axis): the same fields as in Tuning (filters.hpp), in the same order.
struct LaneSettings {
    double log_h;
    double x0, P0, Q, R;
    double alpha0, order_P0, order_Q0, order_R, order_delta;
    double f0, parameter_P0, parameter_Q0, parameter_R, parameter_delta;
    double gate;
};

// An estimate from which a lane (axis) has to continue: the order and the parameter, the variance of each,
// and their covariance. The parameter is f for the variant `triple` and beta for `joint`. Only `joint` uses
// the covariance.
struct FilterModel {
    double alpha, parameter;
    double alpha_variance, covariance, parameter_variance;
};

// Columns into which the estimates are written.
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

// Inputs and outputs for a block of `samples` rows with a number for each lane (axis), stored row by row.
// `y`: the samples. `u`: the known input (filters.hpp), or null if there is none. `missing`: not 0 where a
// sample is missing, or null if none is. `out`: an array for each Column. All inputs are finite.
struct Block {
    std::size_t samples;
    const double* y;
    const double* u;
    const std::uint8_t* missing;
    double* out[kColumns];
};

// Extra arguments of a run under the supervisor (supervisor.hpp). Each lane has its own supervisor. A lane
// that its supervisor declares lost restarts at the next row, together with the supervisor. A run under
// supervisors writes standard deviations into the block's columns instead of variances, and does not write
// the column kP (the variance of the state). All columns are NaN where a lane is not valid.
struct Watch {
    // memory of the supervisors; each lane has Backend::supervisor bytes, which are all zero before the first
    // run
    unsigned char* supervisors;
    // what each lane's supervisor says of each sample: VerdictBits, of shape (samples, lanes)
    std::uint8_t* verdicts;
};

enum VerdictBits : int { kValid = 1, kRestarted = 2, kRanAway = 4, kBound = 8 };

struct Backend {
    const char* name;
    int width;  // number of lanes (axes) in a pack, which is one vector register
    // number of the guard's counters in each lane, one for each cause for which the guard limits a value
    int causes;
    std::size_t supervisor;  // size of the supervisor of one lane in bytes

    // Returns the number of bytes of storage, aligned to 64, that an engine of this shape needs.
    std::size_t (*storage)(const EngineShape& shape);
    // Builds an engine in `storage`. `settings` has one entry per lane.
    void (*start)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // Replaces the settings from the next sample on. `settings` has one entry per lane. The lanes keep their
    // state and memory.
    void (*retune)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // Replaces the estimated order and parameter of one lane (axis). The lane keeps its state and memory.
    void (*set_filter_model)(void* storage, const EngineShape& shape, std::size_t lane,
                             const FilterModel& filter_model);
    void (*run)(void* storage, const EngineShape& shape, const Block& block);
    void (*watch)(void* storage, const EngineShape& shape, const Block& block, const Watch& watch);
    // Restarts the lanes (axes) for which `mask` is not 0.
    void (*reset)(void* storage, const EngineShape& shape, const std::uint8_t* mask);
    // Writes for each lane (axis) and each cause how often the guard limited a value, in the shape (lanes,
    // causes).
    void (*counts)(const void* storage, const EngineShape& shape, std::int32_t* out);
    // Returns the size of a snapshot; `save` writes the snapshot. The settings are not part of a snapshot.
    std::size_t (*snapshot)(const EngineShape& shape);
    void (*save)(const void* storage, const EngineShape& shape, unsigned char* out);
    // Loads a snapshot. Returns false if it cannot come from an engine of this shape, or has impossible
    // numbers. A part of it may have been loaded by then, so the engine has to be discarded or restarted.
    bool (*load)(void* storage, const EngineShape& shape, const unsigned char* in);
};

extern const Backend engine_baseline;
extern const Backend engine_avx2;
extern const Backend engine_avx512;

}  // namespace engine
}  // namespace fltea
