// The memory of past states for a processor without floating point. It is the memory of
// memory_compressed.hpp, computed in integers and without a limit of its length. The state x is kept in units
// of 2^-21 to 2^-20 of the noise's standard deviation sqrt(R). x is clipped at 256 of these standard
// deviations or more, which only a knock exceeds. The weights of the newest FixedNodes::head samples are
// exact. The variance P of a state is kept for these samples only, in float.
//
// It differs from memory_compressed.hpp in three ways. First, orders outside of [-1/2, 5/2] are replaced by
// the nearest order in this range, to which the guard limits them anyway. Second, modes slower than the
// slowest stored mode are replaced by the plain sum of the past. Third, the oldest variance that is kept
// takes the place of all older variances, because the P of a running filter is nearly constant.
// firmware/README.md states the resulting errors.
#ifndef FLTEA_MEMORY_FIXED_HPP
#define FLTEA_MEMORY_FIXED_HPP

#include "fixed_math.hpp"
#include "fixed_nodes.hpp"
#include "pack.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

class FixedMemory {
    typedef FixedNodes<> Nodes;

  public:
    static constexpr float kLowest = -0.5f, kHighest = 2.5f;

    // `R`: variance of the measurement, which determines the unit of the states x.
    explicit FixedMemory(float R) {
        std::uint32_t bits = 0;
        std::memcpy(&bits, &R, sizeof bits);
        const int exponent = static_cast<int>(bits >> 23 & 255) - 127;
        x_unit_ = (exponent >> 1) - 20;
        reset();
    }

    // Forgets all past states.
    void reset() {
        for (std::size_t i = 0; i < Nodes::head; ++i) x_[i] = 0, P_[i] = 0;
        for (std::size_t i = 0; i < Nodes::count; ++i) z_[i] = 0;
        plain_ = 0;
    }
    void clear(bool mask) {
        if (mask) reset();
    }

    // Adds the newest estimate: state x and variance P, which have to be finite.
    void push(float x, float P) {
        const std::int32_t oldest = x_[Nodes::head - 1];
        for (std::size_t i = Nodes::head - 1; i > 0; --i) {
            x_[i] = x_[i - 1];
            P_[i] = P_[i - 1];
        }
        x_[0] = fixed::from_float(x, x_unit_);
        P_[0] = P;
        // Each mode is an exponentially weighted mean of past states, so its magnitude never exceeds that of
        // the largest state.
        for (std::size_t i = 0; i < Nodes::count; ++i) {
            const std::int32_t mean = static_cast<std::int32_t>((z_[i] + (1 << 30)) >> 31);
            z_[i] += static_cast<std::int64_t>(Nodes::forget[i]) * (oldest - mean);
        }
        plain_ += oldest;
    }

    // Computes S_i = sum_{j=1}^{k} c_j(order_i) x_{k-j} for several orders; c_j are the weights of past
    // states.
    template <int N>
    void state_sums(const float (&order)[N], float (&S)[N]) const {
        Order at[N];
        for (int i = 0; i < N; ++i) at[i] = Order(order[i]);
        states(at, S);
    }

    // Computes S = sum_{j=1}^{k} c_j(order) x_{k-j} and V = sum_{j=2}^{k} c_j(order)^2 P_{k-j} for one order,
    // with the same weights c_j as in state_sums().
    void sums(float order, float& S, float& V) const {
        const Order at[1] = {Order(order)};
        float state[1];
        states(at, state);
        S = state[0];
        V = variance(at[0], order);
    }

  private:
    static constexpr int kFine = 16;  // the unit of sums is 2^-16 times the unit of the states

    static std::int64_t fine(std::int32_t x) { return static_cast<std::int64_t>(x) * (1 << kFine); }

    // `a`: an order, in units of 2^-28. `v`: e^{-a step}, in units of 2^-30; its value is between 0.1 and
    // 1.6. e^step is the ratio of neighbouring modes' decay rates.
    struct Order {
        std::int32_t a, v;

        Order() = default;
        explicit Order(float order) {
            a = fixed::from_float(min(max(order, kLowest), kHighest), 2 - kOrderBits) * 4;
            const fixed::Power power = fixed::power_of_two(in_steps(-a, Nodes::step));
            v = power.n >= 0 ? power.m << power.n : power.m >> -power.n;
        }
        // Returns a * step in units of 2^-26. `a`: an order, in units of 2^-28. `step`: binary logarithm of a
        // decay rate or of a ratio of decay rates, in units of 2^-29.
        static std::int32_t in_steps(std::int32_t a, std::int32_t step) {
            return static_cast<std::int32_t>((static_cast<std::int64_t>(a) * step) >> 31);
        }
        // Returns the ratio c_{j+1} / c_j of neighbouring weights of past states, in units of 2^-30.
        std::int32_t next(std::size_t j) const {
            const std::int32_t reciprocal = INT32_MAX / static_cast<std::int32_t>(j + 1);
            const std::int32_t distance = (static_cast<std::int32_t>(j) << kOrderBits) - a;
            return static_cast<std::int32_t>((static_cast<std::int64_t>(distance) * reciprocal) >> 29);
        }
    };
    static constexpr int kOrderBits = 28;

    template <int N>
    void states(const Order (&at)[N], float (&S)[N]) const {
        std::int64_t tail[N];
        tails(at, tail);
        for (int n = 0; n < N; ++n) {
            std::int64_t sum = fine(x_[Nodes::head - 1]);
            for (std::size_t j = Nodes::head - 1; j > 0; --j) {
                sum = fixed::product30(sum, at[n].next(j)) + fine(x_[j - 1]);
            }
            const std::int64_t head = fixed::product30(sum, -at[n].a) * (1 << (30 - kOrderBits));
            // The sum over the modes is multiplied by sin(pi a) and p^a. a is the order, and p the fastest
            // node (decay rate).
            const fixed::Power lift = fixed::power_of_two(Order::in_steps(at[n].a, Nodes::top));
            std::int64_t rest = fixed::product30(fixed::product30(tail[n], fixed::sin_pi(at[n].a)), lift.m);
            rest = lift.n >= 0 ? rest * (1 << lift.n) : rest >> -lift.n;
            S[n] = fixed::to_float(head + rest, x_unit_ - kFine);
        }
    }

    // Computes sum_i v^i K_i z_i over the modes z_i with their weights K_i; v = e^{-a step} as in Order.
    // Infinitely many modes slower than the stored ones are included. In their terms, the plain sum of the
    // past replaces z_i, so that these terms are a geometric series.
    template <int N>
    void tails(const Order (&at)[N], std::int64_t (&sum)[N]) const {
        const std::int64_t slower = fixed::product30(plain_, Nodes::plain);
        for (int n = 0; n < N; ++n) {
            const std::uint32_t g = static_cast<std::uint32_t>(fixed::product30(at[n].v, Nodes::ratio));
            const std::uint32_t series =
                // the geometric series g + g^2 + ... in units of 2^-15: one term for each slower mode; g = v
                // e^-step is the ratio of neighbouring terms
                (g << 1) / (((UINT32_C(1) << 30) - g) >> 14);
            sum[n] = fixed::product30(slower, static_cast<std::int32_t>(series << 15));
        }
        for (std::size_t i = Nodes::count; i > 0; --i) {
            const std::int32_t mean = static_cast<std::int32_t>(z_[i - 1] >> 29);
            const std::int64_t mode = (static_cast<std::int64_t>(mean) * Nodes::weight[i - 1]) >> 17;
            for (int n = 0; n < N; ++n) {
                sum[n] = (i == Nodes::count ? sum[n] : fixed::product30(sum[n], at[n].v)) + mode;
            }
        }
    }

    float variance(const Order& at, float order) const {
        float sum = 0;
        std::int32_t product = 1 << 30;
        for (std::size_t j = Nodes::head - 1; j > 0; --j) {
            const std::int32_t next = at.next(j);
            sum = fixed::to_float(fixed::product30(next, next), -30) * (sum + P_[j]);
            product = fixed::product30(product, next);
        }
        const float a = min(max(order, -0.25f), kHighest), beyond = float(Nodes::head + 1);
        // c_j is the weight of the sample that is j samples old. The sum of c_j^2 over all samples older than
        // those in x_ follows from the Euler-Maclaurin formula.
        const float c = a * fixed::to_float(fixed::product30(product, at.next(Nodes::head)), -30);
        const float rest = P_[Nodes::head - 1] * (c * c) * ((beyond - 0.5f * a) / (1.0f + 2.0f * a) + 0.5f);
        return a * a * sum + rest;
    }

    std::int32_t x_[Nodes::head];  // the newest samples, newest first
    float P_[Nodes::head];
    // the modes, from the fastest to the slowest decay. A mode is an exponentially weighted mean of past
    // states x. Its unit is 2^-31 times the unit of x
    std::int64_t z_[Nodes::count];
    std::int64_t plain_;  // sum of all states that are no longer in x_
    int x_unit_;          // the unit of x is 2^x_unit_
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
