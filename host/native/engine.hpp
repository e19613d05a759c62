// The engine as the binding sees it: plain data and one table of functions per instruction set.
//
// engine.cpp is compiled once per instruction set; each compilation fills one table. Nothing in this file is
// code, so that no function compiled for one set can be linked into another. The caller owns all memory.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fltea {

// Squares of larger numbers, and sums of thousands of them, would leave the range of doubles.
constexpr double kLargestInput = 1e100;

namespace engine {

// What all lanes of an engine have in common. Numbers for the enumerations, which belong to the instruction
// sets' own namespaces.
struct EngineShape {
    std::size_t lanes;
    std::int32_t joint;       // 0: triple (three filters), 1: joint (filters.hpp, joint.hpp)
    std::int32_t guard;       // enum Guard of guard.hpp
    std::int32_t compressed;  // 0: direct memory, 1: compressed
    std::int32_t accuracy;    // compressed: digits of compressed_config(), 0 is its default
    std::size_t window;       // L in samples; 0, with compressed memory only: unlimited
};

// What one lane is told; Tuning of filters.hpp, in the same order.
struct LaneSettings {
    double log_h;
    double x0, P0, Q, R;
    double alpha0, order_P0, order_Q0, order_R, order_delta;
    double f0, parameter_P0, parameter_Q0, parameter_R, parameter_delta;
    double gate;
};

// What a lane takes for granted of its order and its parameter, which is f of `triple` and beta of `joint`:
// the means, their variances, and (joint only) how they go together.
struct Belief {
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

// `samples` rows of `lanes` numbers each, row after row; u and missing may be null (no input, none missing).
// All numbers are finite.
struct Block {
    std::size_t samples;
    const double* y;
    const double* u;
    const std::uint8_t* missing;
    double* out[kColumns];
};

// A run under the supervisor (supervisor.hpp). Lanes that it lost begin again with the next row, and their
// supervisors with them. Of the block's columns, variances become standard deviations, kP is not written, and
// all are NaN where a lane is not valid.
struct Watch {
    unsigned char* supervisors;  // Backend::supervisor bytes a lane; zeros have seen nothing
    std::uint8_t* verdicts;      // (samples, lanes): VerdictBits
};

enum VerdictBits : int { kValid = 1, kRestarted = 2, kRanAway = 4, kBound = 8 };

struct Backend {
    const char* name;
    int width;               // lanes in a pack
    int causes;              // counters a lane
    std::size_t supervisor;  // bytes of one

    // Bytes of storage that an engine of this shape needs, aligned to 64.
    std::size_t (*storage)(const EngineShape& shape);
    // Builds an engine in `storage`; `settings` has one entry a lane.
    void (*start)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // Other settings from the next sample on, one entry a lane; all that the lanes remember stays.
    void (*retune)(void* storage, const EngineShape& shape, const LaneSettings* settings);
    // One lane goes on with this in place of what it has found; its state and its memory stay.
    void (*believe)(void* storage, const EngineShape& shape, std::size_t lane, const Belief& belief);
    void (*run)(void* storage, const EngineShape& shape, const Block& block);
    void (*watch)(void* storage, const EngineShape& shape, const Block& block, const Watch& watch);
    // Lanes whose mask is not 0 begin again.
    void (*reset)(void* storage, const EngineShape& shape, const std::uint8_t* mask);
    // (lanes, causes), row after row.
    void (*counts)(const void* storage, const EngineShape& shape, std::int32_t* out);
    // Size of a snapshot, and the snapshot: settings are not part of it.
    std::size_t (*snapshot)(const EngineShape& shape);
    void (*save)(const void* storage, const EngineShape& shape, unsigned char* out);
    // False if the snapshot cannot come from an engine of this shape whose numbers are sound: some of them
    // have been loaded then, so that it has to be thrown away or started again.
    bool (*load)(void* storage, const EngineShape& shape, const unsigned char* in);
};

extern const Backend engine_baseline;
extern const Backend engine_avx2;
extern const Backend engine_avx512;

}  // namespace engine
}  // namespace fltea
