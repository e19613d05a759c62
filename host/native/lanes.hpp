// Runs lanes of the estimator engine, each under a supervisor that restarts it when its filter has run away.
// A lane is the estimator of one series of samples: an axis of a live sensor, a shuffled copy of its samples,
// or a simulated series.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "owned_engine.hpp"
#include "supervisor.hpp"

namespace fltea {

// Says that the estimates of a lane became invalid at a row of a block, and why.
struct Lost {
    std::size_t row, lane;
    engine::Loss reason;
};

// Columns of the estimates, each of shape (rows, lanes). They are NaN where the lane is not valid.
enum LaneColumn : int {
    kLaneAlpha,
    kLaneAlphaStd,
    kLaneF,
    kLaneFStd,
    kLaneX,
    kLaneInnovation,  // NaN where the sample is missing, even if the lane is valid
    kLaneInnovationStd,
    kLaneColumns
};

class LaneRunner {
  public:
    typedef engine::Supervisor<double> Supervisor;

    LaneRunner(const engine::Backend& backend, const engine::EngineShape& shape,
               const engine::LaneSettings* settings)
        : engine_(backend, shape, settings), supervisors_(shape.lanes), restarts_(shape.lanes, 0) {}

    std::size_t lanes() const { return engine_.lanes(); }
    const OwnedEngine& engine() const { return engine_; }

    // Replaces the settings from the next row on. There is one entry per lane.
    void retune(const engine::LaneSettings* settings) { engine_.retune(settings); }

    void set_filter_model(std::size_t lane, const engine::FilterModel& filter_model) {
        engine_.set_filter_model(lane, filter_model);
    }

    // Processes rows with samples of all lanes. `y`, `missing` (or null) and `valid` have the shape (rows,
    // lanes). `y` is finite where it is not missing; `valid` is set to 0 or 1. Appends each lane that becomes
    // invalid to `lost`, in the order of the rows. The rows in `lost` are counted so that the first row of
    // this block has the number `first`.
    void run(const double* y, const std::uint8_t* missing, std::size_t rows,
             double* const (&columns)[kLaneColumns], std::uint8_t* valid, std::vector<Lost>& lost,
             std::size_t first = 0) {
        static_assert(sizeof(Supervisor) == engine::kBoundSamples / 8 + 3,
                      "supervisors are bytes without gaps");
        engine::Block block = engine::Block();
        block.samples = rows;
        block.y = y;
        block.missing = missing;
        const int places[kLaneColumns] = {
            engine::kAlpha,      engine::kAlphaVariance,     engine::kF, engine::kFVariance, engine::kX,
            engine::kInnovation, engine::kInnovationVariance};
        for (int i = 0; i < kLaneColumns; ++i) block.out[places[i]] = columns[i];
        const engine::Watch under = {reinterpret_cast<unsigned char*>(supervisors_.data()), valid};
        engine_.watch(block, under);
        const std::size_t n = rows * lanes();
        for (std::size_t i = 0; i < n; ++i) {
            const int verdict = valid[i];
            if (verdict == engine::kValid) continue;
            valid[i] = 0;
            const std::size_t lane = i % lanes();
            if (verdict & engine::kRestarted) ++restarts_[lane];
            if (verdict & engine::kRanAway) {
                lost.push_back(Lost{first + i / lanes(), lane, engine::Loss::runaway});
            } else if (verdict & engine::kBound) {
                lost.push_back(Lost{first + i / lanes(), lane, engine::Loss::bound});
            }
        }
    }

    // Number of restarts of each lane since the lanes were created.
    const std::vector<std::uint64_t>& restarts() const { return restarts_; }
    void set_restarts(const std::vector<std::uint64_t>& restarts) { restarts_ = restarts; }

    // Writes for each lane (axis) and each cause how often the guard (guard.hpp) has limited a value since
    // the lane's filters last started, in the shape (lanes, causes).
    void counts(std::int32_t* out) const { engine_.counts(out); }

    std::vector<unsigned char> save() const { return engine_.save(); }
    bool load(const unsigned char* bytes, std::size_t size) { return engine_.load(bytes, size); }

    // Returns the state of the supervisors (firmware/core/engine/supervisor.hpp).
    std::vector<unsigned char> save_supervisors() const {
        const unsigned char* const bytes = reinterpret_cast<const unsigned char*>(supervisors_.data());
        return std::vector<unsigned char>(bytes, bytes + supervisors_.size() * sizeof(Supervisor));
    }

    // Loads the state of the supervisors. Returns false and changes nothing if `bytes` cannot be such a
    // state.
    bool load_supervisors(const unsigned char* bytes, std::size_t size) {
        if (size != supervisors_.size() * sizeof(Supervisor)) return false;
        std::vector<Supervisor> loaded(supervisors_.size());
        std::memcpy(static_cast<void*>(loaded.data()), bytes, size);
        for (const Supervisor& one : loaded) {
            if (!one.plausible()) return false;
        }
        supervisors_ = loaded;
        return true;
    }

  private:
    OwnedEngine engine_;
    std::vector<Supervisor> supervisors_;
    std::vector<std::uint64_t> restarts_;
};

}  // namespace fltea
