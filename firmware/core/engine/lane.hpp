// A lane is the estimator of one axis: the filters, their memory, and the counters of the guard. An object of
// the class Lane is a single lane if T is float or double, as on the device. If T is a Pack, it is several
// lanes, which are computed at once.
#pragma once

#include "joint.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Variant is Triple<T> or Joint<T>. Memory is the class of the memory of past states, for example that of
// memory_direct.hpp or memory_compressed.hpp. A Lane allocates nothing, because its memory of past states
// uses the storage that was passed to the memory's constructor.
template <class T, class Variant, class Memory>
class Lane {
  public:
    using Mask = MaskOf<T>;

    // Everything that changes from step to step, except the memory of past samples. A snapshot of the filters
    // contains exactly this.
    struct State {
        Variant filters;
        T counts[kCauses];
    };
    // number of values of type T in State, which has no other members
    static const std::size_t kStateSize = sizeof(State) / sizeof(T);

    Lane(const Memory& memory, const Tuning<T>& tuning, Guard guard)
        : memory_(memory), tuning_(tuning), guard_(guard), state_() {
        memory_.reset();
        restart(everywhere<T>(true));
    }

    // Restarts the lanes (axes) in `mask` with initial estimates, an empty memory, and counters at zero.
    void reset(Mask mask) {
        memory_.clear(mask);
        restart(mask);
    }

    // Replaces the settings from the next sample on, and at later restarts. The memory keeps its past states.
    void retune(const Tuning<T>& tuning) { tuning_ = tuning; }

    void step(const Sample<T>& sample, Estimate<T>& out) {
        // The estimate for the previous sample is added to the memory only now, so that one lane can restart
        // between two steps while other lanes continue.
        memory_.push(state_.filters.state.x, state_.filters.state.P);
        Guards<T> guards(guard_);
        state_.filters.step(memory_, sample, tuning_, guards, out);
        guards.finish(state_.counts);
    }

    State& state() { return state_; }
    const State& state() const { return state_; }
    Memory& memory() { return memory_; }
    const Memory& memory() const { return memory_; }

  private:
    void restart(Mask mask) {
        State fresh = State();
        fresh.filters.start(tuning_);
        fresh.filters.state.x = tuning_.x0;
        fresh.filters.state.P = tuning_.P0;
        fresh.filters.state.reach = abs(tuning_.x0) + sqrt(tuning_.P0);
        // State consists only of numbers of type T, so the state of one lane (axis) can be replaced alone.
        static_assert(sizeof(State) % sizeof(T) == 0, "State must hold numbers of type T only");
        T* now = reinterpret_cast<T*>(&state_);
        const T* then = reinterpret_cast<const T*>(&fresh);
        for (std::size_t i = 0; i < kStateSize; ++i) now[i] = select(mask, then[i], now[i]);
    }

    Memory memory_;
    Tuning<T> tuning_;
    Guard guard_;
    State state_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
