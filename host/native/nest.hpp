// Sums over the newest samples with the Grünwald–Letnikov weights of the order a, which follow from c_0 = 1
// and c_j = c_{j-1} (1 - (a+1)/j) (Macias & Sierociuk 2023, sections 2 and 4). The sums are computed in
// nested form, as in Horner's scheme.
#ifndef FLTEA_NEST_HPP
#define FLTEA_NEST_HPP

#include "pack.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Computes two sums over past states x_j and their variances P_j, where j = 1 is the newest and j = n the
// oldest: sum_{j=1}^{n} c_j x_j for each of N orders, and, if M is 1, sum_{j=2}^{n} c_j² P_j for the first of
// these orders. The weights c_j depend on the order (see the top of this file).
//
// The first sum is c_1 s_1, where s_j = x_j + (c_{j+1}/c_j) s_{j+1} is computed from j = n down to j = 1; the
// second sum is computed likewise. No weight c_j is computed, so no weight can overflow before the sum does.
template <class T, int N, int M>
class Nest {
    typedef Real<T> R;
    static constexpr int kOrders = N > M ? N : M;
    // Up to this j, the ratio c_j/c_{j-1} is computed as (j-1-a)/j, which is exactly 0 for j = a + 1 if the
    // order a is an integer. For larger j it is computed as 1 - (a+1)/j.
    static constexpr std::size_t kHead = 8;

  public:
    // The weighted sum of past states x_j for each order, and the weighted sum of their variances P_j. Both
    // are valid after run().
    T state[N > 0 ? N : 1];
    T variance;

    explicit Nest(const T (&orders)[kOrders]) {
        for (int i = 0; i < kOrders; ++i) {
            order_[i] = orders[i];
            minus_b_[i] = -(orders[i] + T(R(1)));
            if (i < N) state[i] = T(R(0));
        }
        variance = T(R(0));
    }

    // x[j-1] is the state j samples ago, and P[j-1] its variance. reciprocal[j] has to be 1/j for j up to n +
    // 1.
    void run(const T* x, const T* P, const R* reciprocal, std::size_t n) {
        std::size_t j = n;
        // Each iteration adds two samples. The new sum depends on the previous sum by a single multiply-add
        // for both samples, so the processor waits for one operation where it would wait for two.
        for (; j > kHead; j -= 2) {
            two(x[j - 2], P[j - 2], T(reciprocal[j]), x[j - 1], P[j - 1], T(reciprocal[j + 1]));
        }
        // This loop processes the newest kHead samples. After sample j was added, `state` is the sum so far
        // divided by the weight c_j. At the end j is 1, so `state` is multiplied by c_1 = -a. Likewise,
        // `variance` is divided by c_j² and then multiplied by c_1².
        for (; j > 1; --j) head(x[j - 1], P[j - 1], R(j), reciprocal[j + 1]);
        if (j == 1) head(x[0], T(R(0)), R(1), reciprocal[2]);
        for (int i = 0; i < N; ++i) state[i] = -order_[i] * state[i];
        variance = order_[0] * order_[0] * variance;
    }

  private:
    void two(T x, T P, T reciprocal, T x_older, T P_older, T reciprocal_older) {
        for (int i = 0; i < kOrders; ++i) {
            const T f = mul_add(minus_b_[i], reciprocal, T(R(1)));
            const T f_older = mul_add(minus_b_[i], reciprocal_older, T(R(1)));
            const T product = f * f_older;
            if (i < N) state[i] = mul_add(product, state[i], mul_add(f, x_older, x));
            if (i < M) variance = mul_add(product * product, variance, mul_add(f * f, P_older, P));
        }
    }

    void head(T x, T P, R j, R reciprocal) {
        for (int i = 0; i < kOrders; ++i) {
            const T f = (T(j) - order_[i]) * T(reciprocal);
            if (i < N) state[i] = mul_add(f, state[i], x);
            if (i < M) variance = mul_add(f * f, variance, P);
        }
    }

    T order_[kOrders], minus_b_[kOrders];
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
