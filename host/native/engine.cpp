// The estimator engine for one instruction set (engine.hpp). CMakeLists.txt compiles this file once for each
// instruction set.
#include "packs.hpp"
#include "set_name.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {
namespace {

// Calls `action` with an engine of the settings `shape`. The settings decide of which type the engine is.
template <class Action>
void with_packs(void* storage, const EngineShape& shape, Action& action) {
    if (shape.joint) {
        if (shape.compressed) {
            action(Packs<Joint<Number>, Compressed>(storage, shape));
        } else {
            action(Packs<Joint<Number>, Direct>(storage, shape));
        }
    } else {
        if (shape.compressed) {
            action(Packs<Triple<Number>, Compressed>(storage, shape));
        } else {
            action(Packs<Triple<Number>, Direct>(storage, shape));
        }
    }
}

struct Size {
    const EngineShape& shape;
    std::size_t bytes;
    template <class P>
    void operator()(const P&) {
        bytes = packs(shape) * P::stride(shape);
    }
};
struct Start {
    const LaneSettings* settings;
    template <class P>
    void operator()(P engine) {
        engine.start(settings);
    }
};
struct Retune {
    const LaneSettings* settings;
    template <class P>
    void operator()(P engine) {
        engine.retune(settings);
    }
};
struct SetFilterModel {
    std::size_t lane;
    const FilterModel& filter_model;
    template <class P>
    void operator()(P engine) {
        engine.set_filter_model(lane, filter_model);
    }
};
struct Run {
    const Block& block;
    template <class P>
    void operator()(P engine) {
        engine.run(block);
    }
};
struct RunWatched {
    const Block& block;
    const Watch& under;
    template <class P>
    void operator()(P engine) {
        engine.watch(block, under);
    }
};
struct Reset {
    const std::uint8_t* mask;
    template <class P>
    void operator()(P engine) {
        engine.reset(mask);
    }
};
struct Counts {
    std::int32_t* out;
    template <class P>
    void operator()(P engine) {
        engine.counts(out);
    }
};
struct SnapshotSize {
    std::size_t bytes;
    template <class P>
    void operator()(P engine) {
        bytes = engine.snapshot();
    }
};
struct Save {
    unsigned char* out;
    template <class P>
    void operator()(P engine) {
        engine.save(out);
    }
};
struct Load {
    const unsigned char* in;
    bool loaded;
    template <class P>
    void operator()(P engine) {
        loaded = engine.load(in);
    }
};

std::size_t storage(const EngineShape& shape) {
    Size size = {shape, 0};
    with_packs(nullptr, shape, size);
    return size.bytes;
}
void start(void* engine, const EngineShape& shape, const LaneSettings* settings) {
    Start action = {settings};
    with_packs(engine, shape, action);
}
void retune(void* engine, const EngineShape& shape, const LaneSettings* settings) {
    Retune action = {settings};
    with_packs(engine, shape, action);
}
void set_filter_model(void* engine, const EngineShape& shape, std::size_t lane,
                      const FilterModel& filter_model) {
    SetFilterModel action = {lane, filter_model};
    with_packs(engine, shape, action);
}
void run(void* engine, const EngineShape& shape, const Block& block) {
    Run action = {block};
    with_packs(engine, shape, action);
}
void watch(void* engine, const EngineShape& shape, const Block& block, const Watch& under) {
    RunWatched action = {block, under};
    with_packs(engine, shape, action);
}
void reset(void* engine, const EngineShape& shape, const std::uint8_t* mask) {
    Reset action = {mask};
    with_packs(engine, shape, action);
}
void counts(const void* engine, const EngineShape& shape, std::int32_t* out) {
    Counts action = {out};
    with_packs(const_cast<void*>(engine), shape, action);
}
std::size_t snapshot(const EngineShape& shape) {
    SnapshotSize size = {0};
    with_packs(nullptr, shape, size);
    return size.bytes;
}
void save(const void* engine, const EngineShape& shape, unsigned char* out) {
    Save action = {out};
    with_packs(const_cast<void*>(engine), shape, action);
}
bool load(void* engine, const EngineShape& shape, const unsigned char* in) {
    Load action = {in, false};
    with_packs(engine, shape, action);
    return action.loaded;
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

const Backend FLTEA_JOIN(engine_, FLTEA_INSTRUCTION_SET) = {FLTEA_STRING(FLTEA_INSTRUCTION_SET),
                                                            kWidth,
                                                            kCauses,
                                                            sizeof(OneSupervisor),
                                                            storage,
                                                            start,
                                                            retune,
                                                            set_filter_model,
                                                            run,
                                                            watch,
                                                            reset,
                                                            counts,
                                                            snapshot,
                                                            save,
                                                            load};

}  // namespace engine
}  // namespace fltea
