// Runs packs of lanes one after another, for one instruction set. A pack is one vector register of lanes, and
// a lane is one axis. engine.cpp fills its table with these functions. They call no inline function of the
// standard library: the linker would keep only one of its compiled copies, and use this copy for all
// instruction sets.
#pragma once

#include <new>

#include "engine.hpp"
#include "lane.hpp"
#include "memory_compressed.hpp"
#include "memory_direct.hpp"
#include "supervisor.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

typedef Pack<double, kWidth> Number;
typedef Supervisor<double> OneSupervisor;
const std::size_t kLanesInPack = kWidth;
const std::size_t kAlignment = 64;

inline std::size_t rounded_up(std::size_t bytes) {
    return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}
inline std::size_t packs(const EngineShape& shape) { return (shape.lanes + kLanesInPack - 1) / kLanesInPack; }

// Largest number of samples that a snapshot may state. No sensor delivers so many samples, and the counters
// would wrap only far beyond this number.
const std::uint64_t kMostPushed = std::uint64_t(1) << 52;

// The two kinds of memory of past states. Each of the two structs says how much storage its memory needs, and
// creates the memory.
struct Direct {
    typedef DirectMemory<Number> Memory;
    static std::size_t storage(const EngineShape& shape) { return Memory::storage(shape.window); }
    static Memory make(Number* storage, const EngineShape& shape) { return Memory(storage, shape.window); }
    static std::size_t history(const EngineShape& shape) { return Memory::history(shape.window); }
    static bool plausible(const Memory::Position& at, const EngineShape& shape) {
        return at.pushed <= kMostPushed && at.position < shape.window &&
               (at.position + at.pushed) % shape.window == 0;
    }
};

struct Compressed {
    typedef CompressedMemory<Number> Memory;
    static std::size_t storage(const EngineShape& shape) { return Memory::storage(config(shape)); }
    static Memory make(Number* storage, const EngineShape& shape) { return Memory(storage, config(shape)); }
    static CompressedConfig config(const EngineShape& shape) {
        return compressed_config(shape.window, shape.accuracy);
    }
    static std::size_t history(const EngineShape& shape) { return Memory::history(config(shape)); }
    static bool plausible(const Memory::Position& at, const EngineShape&) { return at.pushed <= kMostPushed; }
};

// Whether the filters of a lane (axis) can have reached this state. The caller has already checked that all
// numbers of the state are finite.
inline bool sound(const StateBelief<Number>& state, int lane) {
    return state.P[lane] >= 0 && state.V[lane] >= 0 && state.reach[lane] >= 0;
}
inline bool sound_order(double order, Guard guard) {
    return guard == Guard::off || (order >= 0 && order <= 2);
}
inline bool sound(const Triple<Number>& filters, int lane, Guard guard) {
    const Walk<Number>&order = filters.order, &parameter = filters.parameter;
    return sound(filters.state, lane) && sound_order(order.mean[lane], guard) && order.P[lane] >= 0 &&
           order.Q[lane] >= 0 && parameter.P[lane] >= 0 && parameter.Q[lane] >= 0;
}
inline bool sound(const Joint<Number>& filters, int lane, Guard guard) {
    return sound(filters.state, lane) && sound_order(filters.alpha[lane], guard) && filters.P.aa[lane] >= 0 &&
           filters.P.bb[lane] >= 0 && filters.Q.aa[lane] >= 0 && filters.Q.bb[lane] >= 0;
}

inline void set_filter_model(Triple<Number>& filters, int lane, const FilterModel& filter_model) {
    set_lane(filters.order.mean, lane, filter_model.alpha);
    set_lane(filters.order.P, lane, filter_model.alpha_variance);
    set_lane(filters.parameter.mean, lane, filter_model.parameter);
    set_lane(filters.parameter.P, lane, filter_model.parameter_variance);
}
inline void set_filter_model(Joint<Number>& filters, int lane, const FilterModel& filter_model) {
    set_lane(filters.alpha, lane, filter_model.alpha);
    set_lane(filters.beta, lane, filter_model.parameter);
    set_lane(filters.P.aa, lane, filter_model.alpha_variance);
    set_lane(filters.P.ab, lane, filter_model.covariance);
    set_lane(filters.P.bb, lane, filter_model.parameter_variance);
}

// An engine for one variant of the filters and one kind of memory. The engine processes lanes (axes) in packs
// of as many as fit into a vector register. The packs are stored one after another. Each is an object of
// class Lane, whose numbers are vectors, followed by the storage of its memory.
template <class Variant, class Kind>
class Packs {
  public:
    typedef typename Kind::Memory Memory;
    typedef typename Memory::Position Position;
    typedef Lane<Number, Variant, Memory> PackOfLanes;

    Packs(void* storage, const EngineShape& shape)
        : base_(static_cast<unsigned char*>(storage)), shape_(shape) {}

    static std::size_t stride(const EngineShape& shape) {
        return rounded_up(sizeof(PackOfLanes)) + rounded_up(Kind::storage(shape) * sizeof(Number));
    }

    void start(const LaneSettings* settings) {
        for (std::size_t i = 0; i < packs(shape_); ++i) {
            Tuning<Number> tuning;
            gather_tuning(settings, i, tuning);
            new (at(i))
                PackOfLanes(Kind::make(memory_storage(i), shape_), tuning, static_cast<Guard>(shape_.guard));
        }
    }

    void retune(const LaneSettings* settings) {
        for (std::size_t i = 0; i < packs(shape_); ++i) {
            Tuning<Number> tuning;
            gather_tuning(settings, i, tuning);
            lane(i).retune(tuning);
        }
    }

    void set_filter_model(std::size_t k, const FilterModel& filter_model) {
        engine::set_filter_model(lane(k / kLanesInPack).state().filters, static_cast<int>(k % kLanesInPack),
                                 filter_model);
    }

    void run(const Block& block) {
        for (std::size_t i = 0; i < packs(shape_); ++i) run_pack(lane(i), i, block);
    }

    void watch(const Block& block, const Watch& watch) {
        for (std::size_t i = 0; i < packs(shape_); ++i) watch_pack(lane(i), i, block, watch);
    }

    void reset(const std::uint8_t* mask) {
        for (std::size_t i = 0; i < packs(shape_); ++i) lane(i).reset(flags(mask, i));
    }

    void counts(std::int32_t* out) const {
        for (std::size_t k = 0; k < shape_.lanes; ++k) {
            const typename PackOfLanes::State& state = lane(k / kLanesInPack).state();
            for (int cause = 0; cause < kCauses; ++cause) {
                const double count = get_lane(state.counts[cause], static_cast<int>(k % kLanesInPack));
                *out++ = count < 2147483647.0 ? static_cast<std::int32_t>(count) : 2147483647;
            }
        }
    }

    // For each pack of lanes, a snapshot contains the bytes of the filters (Lane::State), of the position in
    // the memory of past states (Memory::Position), and of this memory's storage including the tables.
    std::size_t snapshot() const {
        return packs(shape_) * (sizeof(typename PackOfLanes::State) + sizeof(Position) +
                                Kind::storage(shape_) * sizeof(Number));
    }

    void save(unsigned char* out) const {
        for (std::size_t i = 0; i < packs(shape_); ++i) {
            out = put(out, &lane(i).state(), sizeof(typename PackOfLanes::State));
            const Position position = lane(i).memory().position();
            out = put(out, &position, sizeof position);
            out = put(out, memory_storage(i), Kind::storage(shape_) * sizeof(Number));
        }
    }

    // Loads a snapshot of the right size. Returns false if the snapshot cannot come from this engine. The
    // engine then has to be discarded.
    bool load(const unsigned char* in) {
        const std::size_t history = Kind::history(shape_), all = Kind::storage(shape_);
        for (std::size_t i = 0; i < packs(shape_); ++i) {
            in = get(in, &lane(i).state(), sizeof(typename PackOfLanes::State));
            Position position;
            in = get(in, &position, sizeof position);
            if (!Kind::plausible(position, shape_)) return false;
            lane(i).memory().set_position(position);
            // The tables in the snapshot's storage are skipped. The engine keeps its own tables, so that a
            // damaged snapshot cannot corrupt them.
            get(in, memory_storage(i), history * sizeof(Number));
            in += all * sizeof(Number);
            if (!sound_pack(i)) return false;
        }
        return true;
    }

  private:
    void* at(std::size_t i) const { return base_ + i * stride(shape_); }
    PackOfLanes& lane(std::size_t i) const { return *static_cast<PackOfLanes*>(at(i)); }
    Number* memory_storage(std::size_t i) const {
        return static_cast<Number*>(
            static_cast<void*>(base_ + i * stride(shape_) + rounded_up(sizeof(PackOfLanes))));
    }
    static unsigned char* put(unsigned char* out, const void* data, std::size_t bytes) {
        __builtin_memcpy(out, data, bytes);
        return out + bytes;
    }
    static const unsigned char* get(const unsigned char* in, void* data, std::size_t bytes) {
        __builtin_memcpy(data, in, bytes);
        return in + bytes;
    }

    // Number of lanes (axes) of pack i that are in use. The last pack may have further, unused lanes. These
    // have the settings of the last lane in use, and zeros as input.
    std::size_t used(std::size_t i) const {
        const std::size_t rest = shape_.lanes - i * kLanesInPack;
        return rest < kLanesInPack ? rest : kLanesInPack;
    }

    void gather_tuning(const LaneSettings* settings, std::size_t i, Tuning<Number>& tuning) const {
        static_assert(sizeof(Tuning<double>) == sizeof(LaneSettings), "one field here is one there");
        const std::size_t fields = sizeof(LaneSettings) / sizeof(double);
        Number* to = reinterpret_cast<Number*>(&tuning);
        for (std::size_t l = 0; l < kLanesInPack; ++l) {
            const std::size_t k = i * kLanesInPack + (l < used(i) ? l : used(i) - 1);
            const double* from = reinterpret_cast<const double*>(settings + k);
            for (std::size_t field = 0; field < fields; ++field)
                set_lane(to[field], static_cast<int>(l), from[field]);
        }
    }

    MaskOf<Number> flags(const std::uint8_t* row, std::size_t i) const {
        Number raised = Number(0.0);
        for (std::size_t l = 0; l < used(i); ++l) {
            set_lane(raised, static_cast<int>(l), row[i * kLanesInPack + l] ? 1.0 : 0.0);
        }
        return raised > Number(0.0);
    }

    Number numbers(const double* row, std::size_t i) const {
        Number values = Number(0.0);
        const double* from = row + i * kLanesInPack;
        if (used(i) == kLanesInPack) {
            __builtin_memcpy(&values, from, sizeof values);
        } else {
            for (std::size_t l = 0; l < used(i); ++l) set_lane(values, static_cast<int>(l), from[l]);
        }
        return values;
    }

    // Reads the samples of row k for the lanes (axes) of pack i.
    void take(std::size_t i, const Block& block, std::size_t k, Sample<Number>& sample) const {
        const std::size_t row = k * shape_.lanes;
        sample.y = numbers(block.y + row, i);
        if (block.u) sample.u = numbers(block.u + row, i);
        if (block.missing) {
            sample.missing = flags(block.missing + row, i);
            // the value of a missing sample may be anything, so it is replaced
            sample.y = select(sample.missing, Number(0.0), sample.y);
        }
    }

    void put_column(const Number& values, double* column, std::size_t i, std::size_t k) const {
        __builtin_memcpy(column + k * shape_.lanes + i * kLanesInPack, &values, used(i) * sizeof(double));
    }

    void run_pack(PackOfLanes& pack, std::size_t i, const Block& block) const {
        Sample<Number> sample = {Number(0.0), Number(0.0), everywhere<Number>(false)};
        for (std::size_t k = 0; k < block.samples; ++k) {
            take(i, block, k, sample);
            Estimate<Number> estimate;
            pack.step(sample, estimate);
            static_assert(sizeof estimate == kColumns * sizeof(Number), "one column is one number");
            const Number* columns = &estimate.alpha;
            for (int column = 0; column < kColumns; ++column) {
                put_column(columns[column], block.out[column], i, k);
            }
        }
    }

    void watch_pack(PackOfLanes& pack, std::size_t i, const Block& block, const Watch& watch) const {
        static_assert(alignof(OneSupervisor) == 1, "supervisors stand in bytes, one after the other");
        OneSupervisor* const supervisors =
            static_cast<OneSupervisor*>(static_cast<void*>(watch.supervisors)) + i * kLanesInPack;
        const int lanes = static_cast<int>(used(i));
        const Number nan = Number(__builtin_nan("")), zero = Number(0.0);
        bool calm = all_calm(supervisors, lanes);
        Sample<Number> sample = {Number(0.0), Number(0.0), everywhere<Number>(false)};
        for (std::size_t k = 0; k < block.samples; ++k) {
            take(i, block, k, sample);
            Estimate<Number> estimate;
            const Number before = pack.state().counts[kStateBound];
            pack.step(sample, estimate);
            std::uint8_t* const verdicts = watch.verdicts + k * shape_.lanes + i * kLanesInPack;
            const MaskOf<Number> held = pack.state().counts[kStateBound] > before;
            const MaskOf<Number> good = (abs(estimate.alpha) <= Number(double(kLostOrder))) &
                                        is_finite(estimate.f) & is_finite(estimate.x) & !held;
            MaskOf<Number> valid = everywhere<Number>(true);
            if (calm && all(good)) {
                __builtin_memset(verdicts, kValid, used(i));
            } else {
                MaskOf<Number> restart = everywhere<Number>(false);
                for (int l = 0; l < lanes; ++l) {
                    const OneSupervisor::Verdict verdict =
                        supervisors[l].judge(estimate.alpha[l], estimate.f[l], estimate.x[l], held[l]);
                    verdicts[l] = static_cast<std::uint8_t>((verdict.valid ? kValid : 0) |
                                                            (verdict.restart ? kRestarted : 0) |
                                                            (verdict.news == Loss::runaway ? kRanAway : 0) |
                                                            (verdict.news == Loss::bound ? kBound : 0));
                    valid.set(l, verdict.valid);
                    restart.set(l, verdict.restart);
                    if (verdict.restart) supervisors[l] = OneSupervisor();
                }
                if (any(restart)) pack.reset(restart);
                calm = all_calm(supervisors, lanes);
            }
            const Number columns[kColumns] = {
                estimate.alpha,      sqrt(max(estimate.alpha_variance, zero)),
                estimate.f,          sqrt(max(estimate.f_variance, zero)),
                estimate.x,          nan,
                estimate.innovation, sqrt(max(estimate.innovation_variance, zero))};
            for (int column = 0; column < kColumns; ++column) {
                if (column != kP) put_column(select(valid, columns[column], nan), block.out[column], i, k);
            }
        }
    }

    static bool all_calm(const OneSupervisor* supervisors, int lanes) {
        bool calm = true;
        for (int l = 0; l < lanes; ++l) calm = calm && supervisors[l].calm();
        return calm;
    }

    // Whether the state that was loaded into a pack is possible. The unused lanes of the pack do not matter.
    bool sound_pack(std::size_t i) const {
        const typename PackOfLanes::State& state = lane(i).state();
        const Number* const numbers = static_cast<const Number*>(static_cast<const void*>(&state));
        const Number* const memory = memory_storage(i);
        const std::size_t n = sizeof state / sizeof(Number), history = Kind::history(shape_);
        for (int l = 0; l < static_cast<int>(used(i)); ++l) {
            bool good = sound(state.filters, l, static_cast<Guard>(shape_.guard));
            for (std::size_t k = 0; k < n; ++k) good = good && __builtin_isfinite(numbers[k][l]);
            for (std::size_t k = 0; k < history; ++k) good = good && __builtin_isfinite(memory[k][l]);
            for (int cause = 0; cause < kCauses; ++cause) {
                const double count = state.counts[cause][l];
                good = good && count >= 0 && count <= double(kMostPushed) && __builtin_floor(count) == count;
            }
            if (!good) return false;
        }
        return true;
    }

    unsigned char* base_;
    EngineShape shape_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
