// An estimator engine that owns its memory. The methods call the functions that were compiled for its
// instruction set (engine.hpp).
#pragma once

#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "engine.hpp"

namespace fltea {

class OwnedEngine {
  public:
    // `settings` has one entry per lane; a lane is one axis.
    OwnedEngine(const engine::Backend& backend, const engine::EngineShape& shape,
                const engine::LaneSettings* settings)
        : backend_(backend), shape_(shape), bytes_(backend.storage(shape)) {
        const std::size_t alignment = 64;
        owned_.reset(new unsigned char[bytes_ + alignment]);
        const std::uintptr_t address = reinterpret_cast<std::uintptr_t>(owned_.get());
        storage_ = owned_.get() + (alignment - address % alignment) % alignment;
        // The memory is cleared, because snapshots also contain the unused bytes between its parts, and have
        // to be reproducible.
        std::memset(storage_, 0, bytes_);
        backend_.start(storage_, shape_, settings);
    }

    const engine::Backend& backend() const { return backend_; }
    const engine::EngineShape& shape() const { return shape_; }
    std::size_t lanes() const { return shape_.lanes; }
    std::size_t causes() const { return static_cast<std::size_t>(backend_.causes); }
    std::size_t bytes() const { return bytes_; }

    // Replaces the settings from the next row on. `settings` has one entry per lane (axis).
    void retune(const engine::LaneSettings* settings) { backend_.retune(storage_, shape_, settings); }
    // Replaces the order and the parameter of one lane (axis) from the next row on.
    void set_filter_model(std::size_t lane, const engine::FilterModel& filter_model) {
        backend_.set_filter_model(storage_, shape_, lane, filter_model);
    }
    void run(const engine::Block& block) { backend_.run(storage_, shape_, block); }
    void watch(const engine::Block& block, const engine::Watch& under) {
        backend_.watch(storage_, shape_, block, under);
    }
    void reset(const std::uint8_t* mask) { backend_.reset(storage_, shape_, mask); }
    void counts(std::int32_t* out) const { backend_.counts(storage_, shape_, out); }

    std::vector<unsigned char> save() const {
        std::vector<unsigned char> bytes(backend_.snapshot(shape_));
        backend_.save(storage_, shape_, bytes.data());
        return bytes;
    }

    // Loads a snapshot. If `bytes` cannot come from save() of such an engine, restarts the engine and returns
    // false.
    bool load(const unsigned char* bytes, std::size_t size) {
        if (size != backend_.snapshot(shape_)) return false;
        if (backend_.load(storage_, shape_, bytes)) return true;
        const std::vector<std::uint8_t> all(shape_.lanes, 1);
        backend_.reset(storage_, shape_, all.data());
        return false;
    }

  private:
    const engine::Backend& backend_;
    engine::EngineShape shape_;
    std::size_t bytes_;
    std::unique_ptr<unsigned char[]> owned_;
    unsigned char* storage_ = nullptr;
};

}  // namespace fltea
