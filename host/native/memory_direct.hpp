// The exact memory of past states: the last `window` estimates, weighted by the Grünwald–Letnikov recurrence
// (nest.hpp). A step takes a time proportional to `window`. This memory follows the paper's algorithm
// exactly. Tests compare the compressed memory with it.
#ifndef FLTEA_MEMORY_DIRECT_HPP
#define FLTEA_MEMORY_DIRECT_HPP

#include "nest.hpp"
#include "pack.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// T: float, double or Pack. An empty memory is equivalent to a past of zeros.
//
// Any order is allowed. Sums that overflow T become infinite or NaN, as in the paper's algorithm. For orders
// in [-2, 30] no double overflows.
template <class T>
class DirectMemory {
    typedef Real<T> R;

  public:
    // Number of elements of type T that the constructor needs for a window of `window` >= 1 samples.
    static std::size_t storage(std::size_t window) {
        return history(window) + (window + kReciprocals + Lanes<T>::count - 1) / Lanes<T>::count;
    }
    // Number of elements that hold past samples. They come first in the storage. The other elements are
    // tables.
    static std::size_t history(std::size_t window) { return 4 * window; }

    // `storage` holds storage(window) elements, aligned for T. The caller owns it.
    DirectMemory(T* storage, std::size_t window)
        : x_(storage),
          P_(storage + 2 * window),
          reciprocal_(reinterpret_cast<R*>(storage + 4 * window)),
          window_(window) {
        for (std::size_t j = 0; j < window + kReciprocals; ++j) reciprocal_[j] = R(1) / R(j > 0 ? j : 1);
        reset();
    }

    // Forgets all past states, in all lanes (axes).
    void reset() {
        for (std::size_t i = 0; i < 4 * window_; ++i) x_[i] = T(R(0));
        position_ = 0;
        pushed_ = 0;
    }

    // Forgets all past states of the lanes (axes) in `mask`.
    void clear(MaskOf<T> mask) {
        for (std::size_t i = 0; i < 4 * window_; ++i) x_[i] = select(mask, T(R(0)), x_[i]);
    }

    // Adds the newest estimate: state x and variance P. Both have to be finite, because a NaN would stay in
    // the sums for a whole window.
    void push(T x, T P) {
        // Each sample is written to two places at a distance of `window`, so that the samples of the window
        // always lie next to each other, newest first.
        position_ = (position_ == 0 ? window_ : position_) - 1;
        x_[position_] = x_[position_ + window_] = x;
        P_[position_] = P_[position_ + window_] = P;
        ++pushed_;
    }

    std::size_t window() const { return window_; }
    // Number of past samples that the sums use: L(k) = min(k, window).
    std::size_t length() const { return pushed_ < window_ ? static_cast<std::size_t>(pushed_) : window_; }

    // Computes S_i = sum_{j=1}^{L(k)} c_j(order_i) x_{k-j} for several orders at once. c_j are the weights of
    // past states, and L(k) is the number of past states in use.
    template <int N>
    void state_sums(const T (&order)[N], T (&S)[N]) const {
        Nest<T, N, 0> nest(order);
        run(nest);
        for (int i = 0; i < N; ++i) S[i] = nest.state[i];
    }

    // Computes V = sum_{j=2}^{L(k)} c_j² P_{k-j} for one order. P_{k-j} is the variance of the state j
    // samples ago. The weights c_j, which depend on the order, and the number L(k) of past states are those
    // of state_sums().
    T variance_sum(T order) const {
        const T orders[1] = {order};
        Nest<T, 0, 1> nest(orders);
        run(nest);
        return nest.variance;
    }

    // Computes the sum S of past states (state_sums()) and the sum V of their variances (variance_sum()) for
    // one order together, which takes less time than one after the other.
    void sums(T order, T& S, T& V) const {
        const T orders[1] = {order};
        Nest<T, 1, 1> nest(orders);
        run(nest);
        S = nest.state[0];
        V = nest.variance;
    }

    // What a snapshot has to contain in addition to the storage.
    struct Position {
        std::uint64_t position, pushed;
    };
    Position position() const { return Position{position_, pushed_}; }
    void set_position(Position saved) {
        position_ = static_cast<std::size_t>(saved.position);
        pushed_ = saved.pushed;
    }

  private:
    // two elements more than the window: 1/0, which is never used, and 1/(window + 1)
    static constexpr std::size_t kReciprocals = 2;

    template <int N, int M>
    void run(Nest<T, N, M>& nest) const {
        nest.run(x_ + position_, P_ + position_, reciprocal_, length());
    }

    T* x_;
    T* P_;
    R* reciprocal_;  // reciprocal_[j] is 1/j
    std::size_t window_;
    std::size_t position_ = 0;
    std::uint64_t pushed_ = 0;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
