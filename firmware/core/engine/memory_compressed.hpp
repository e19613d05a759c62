// A memory of past states whose computing time does not grow with the number of samples. The weights of the
// newest 15 samples come from their recurrence (host/native/nest.hpp). All older samples are represented by a
// few dozen exponentially decaying sums, called modes, which serve all orders (memory_nodes.hpp).
#ifndef FLTEA_MEMORY_COMPRESSED_HPP
#define FLTEA_MEMORY_COMPRESSED_HPP

#include "memory_nodes.hpp"
#include "pack.hpp"
#include "pack_math.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// T: float, double or Pack. For orders in [-0.9, 3], the sums have the configured accuracy. For orders down
// to -1.95 (variance sum: -1.3) and up to 4, their accuracy is lower. An order outside of these limits is
// replaced by the nearest limit, so every finite order has a finite sum. At integer orders from 0 on, the
// modes contribute nothing and the result is exact. A caller who does not want such a replacement has to clip
// the order beforehand. An empty memory is equivalent to a past of zeros.
//
// Below order -1 the weights grow with age and the integrals over the modes diverge. The sums are then
// defined by analytic continuation, which the closed form in slow_end() gives automatically.
template <class T>
class CompressedMemory {
    typedef Real<T> R;

  public:
    // Number of elements of type T that the constructor needs.
    static std::size_t storage(const CompressedConfig& config) {
        const Nodes nodes(config);
        return history_size(nodes) + (table_size(nodes) + Lanes<T>::count - 1) / Lanes<T>::count;
    }
    // Number of elements that hold past samples. They come first, and the other elements are tables.
    static std::size_t history(const CompressedConfig& config) { return history_size(Nodes(config)); }

    // `storage` holds storage(config) elements, aligned for T. The caller owns it.
    CompressedMemory(T* storage, const CompressedConfig& config) : nodes_(config), history_(storage) {
        T* next = storage;
        x_ = take(next, 2 * Nodes::kHead);
        P_ = take(next, 2 * Nodes::kHead);
        state_ = take(next, nodes_.state.count + 1);
        variance_ = take(next, nodes_.variance.count + 1);
        ring_ = take(next, 2 * ring_length(nodes_));
        R* table = reinterpret_cast<R*>(next);
        state_table_ = take(table, 3 * nodes_.state.count);
        variance_table_ = take(table, 3 * nodes_.variance.count);
        w_ = take(table, nodes_.variance.count);
        head_table_ = take(table, 3 * Nodes::kHead);
        tabulate();
        reset();
    }

    // Forgets all past states, in all lanes (axes).
    void reset() {
        const std::size_t n = history_size(nodes_);
        for (std::size_t i = 0; i < n; ++i) history_[i] = T(R(0));
        set_position(Position{0});
    }

    // Forgets all past states of the lanes (axes) in `mask`.
    void clear(MaskOf<T> mask) {
        const std::size_t n = history_size(nodes_);
        for (std::size_t i = 0; i < n; ++i) history_[i] = select(mask, T(R(0)), history_[i]);
    }

    // Adds the newest estimate: state x and variance P. Both have to be finite, because a NaN would stay in
    // the sums forever.
    void push(T x, T P) {
        // The oldest of the newest 15 samples moves to the modes, the decaying sums of older samples.
        head_position_ = (head_position_ == 0 ? Nodes::kHead : head_position_) - 1;
        T *const new_x = x_ + head_position_, *const new_P = P_ + head_position_;
        const T x_in = new_x[0], P_in = new_P[0];
        new_x[0] = new_x[Nodes::kHead] = x;
        new_P[0] = new_P[Nodes::kHead] = P;
        ++pushed_;
        if (nodes_.state.count == 0) return;
        T x_out = T(R(0)), P_out = T(R(0));
        if (nodes_.window > 0) {
            T* const slot = ring_ + 2 * ring_position_;
            ring_position_ = (ring_position_ + 1 == ring_length(nodes_) ? 0 : ring_position_ + 1);
            __builtin_prefetch(slot + 2 * kPrefetch, 1);
            __builtin_prefetch(slot + 2 * kPrefetch + 1, 1);
            x_out = slot[0];
            P_out = slot[1];
            slot[0] = x_in;
            slot[1] = P_in;
        }
        advance(state_, state_table_, state_forgotten_, nodes_.state.count, x_in, x_out);
        advance(variance_, variance_table_, variance_forgotten_, nodes_.variance.count, P_in, P_out);
    }

    // Length L of the memory in samples; 0: unlimited.
    std::size_t window() const { return nodes_.window; }

    // S_i = sum_{j=1}^{L(k)} c_j(order_i) x_{k-j} for several orders; c_j: weights; L(k) = min(k, window).
    template <int N>
    void state_sums(const T (&order)[N], T (&S)[N]) const {
        Order orders[N];
        for (int i = 0; i < N; ++i) orders[i] = at(order[i], kLowestOrder);
        state_heads(orders, S);
        if (nodes_.state.count > 0) add_state_tails(orders, S);
    }

    // Computes V = sum_{j=2}^{L(k)} c_j(order)^2 P_{k-j}. c_j is the weight of the state j samples ago,
    // P_{k-j} its variance, L(k) the length of the memory. V is not negative if no P is negative.
    T variance_sum(T order) const { return variance(at(order, kLowestVarianceOrder)); }

    // Computes both sums for one order: S of state_sums(), and V and the range of orders of variance_sum().
    void sums(T order, T& S, T& V) const {
        const Order orders[1] = {at(order, kLowestVarianceOrder)};
        T state[1];
        state_heads(orders, state);
        if (nodes_.state.count > 0) add_state_tails(orders, state);
        S = state[0];
        V = variance(orders[0]);
    }

    // What a snapshot has to contain in addition to the storage.
    struct Position {
        std::uint64_t pushed;
    };
    Position position() const { return Position{pushed_}; }
    void set_position(Position saved) {
        pushed_ = saved.pushed;
        constexpr std::size_t n = Nodes::kHead;
        head_position_ = n - 1 - static_cast<std::size_t>((pushed_ + n - 1) % n);
        const std::size_t length = ring_length(nodes_);
        ring_position_ = length > 0 ? static_cast<std::size_t>(pushed_ % length) : 0;
    }

    const Nodes& nodes() const { return nodes_; }

  private:
    // Memory is prefetched for the call of push() that comes this number of calls later. Beyond the end of
    // the ring, prefetching has no effect.
    static constexpr std::size_t kPrefetch = 16;

    // What the sums need to know about one order.
    struct Order {
        T order;
        T b, sine;         // b = a + 1 and sin(pi a), with a: the order, but a little away from -1 (see at())
        Powers<T> powers;  // e^{a step} and e^{-a step}; e^step: ratio of neighbouring modes' decay rates
    };

    // Returns the values of Order for an order, which is first limited to the memory's range. `lowest`:
    // kLowestOrder or kLowestVarianceOrder.
    Order at(T order, double lowest) const {
        order = min(max(order, T(R(lowest))), T(R(kHighestOrder)));
        // At a = -1 the sums over the modes are 0 times infinity, and near -1 their rounding error is divided
        // by the distance of a from -1. So a is kept at this distance.
        const T distance = T(sizeof(R) == 8 ? R(1e-8) : R(1e-4));
        const T a = select(abs(order + T(R(1))) < distance, distance - T(R(1)), order);
        return Order{order, a + T(R(1)), sin_pi(a), exp_both(a * T(R(nodes_.step)))};
    }

    // Sums over the newest 15 samples with exact weights: c_j = (-a)(1-a) ... (j-1-a) / j!, by nested
    // products. At an integer order, one of these factors is 0 for large j, so c_j is exactly 0.
    template <int N>
    void state_heads(const Order (&orders)[N], T (&S)[N]) const {
        const T* const x = x_ + head_position_;
        for (int i = 0; i < N; ++i) S[i] = T(R(0));
        for (std::size_t j = Nodes::kHead; j > 0; --j) {
            const R* const row = head_table_ + 3 * (j - 1);
            const T scaled = x[j - 1] * T(row[1]);
            for (int i = 0; i < N; ++i) S[i] = mul_add(T(row[0]) - orders[i].order, S[i], scaled);
        }
        for (int i = 0; i < N; ++i) S[i] = -orders[i].order * S[i];
    }
    T variance_head(const Order& at) const {
        const T* const P = P_ + head_position_;
        T V = T(R(0));
        for (std::size_t j = Nodes::kHead; j > 1; --j) {
            const R* const row = head_table_ + 3 * (j - 1);
            const T factor = T(row[0]) - at.order;
            V = mul_add(factor * factor, V, P[j - 1] * T(row[2]));
        }
        const T factor = at.order * (T(R(1)) - at.order);
        return factor * factor * V;
    }

    // Advances each mode z (a decaying sum of past samples): z becomes z - om z + K in - KW out. `in`: new
    // sample, with the weight K. `out`: sample that leaves the memory, with the weight KW that is left of K.
    // om: decay per sample; z (1 - om) would lose digits of a small om. The first `forgotten` modes have no
    // `out`: nothing is left of it there. The last element of z is the plain sum of the samples in the modes.
    static void advance(T* z, const R* table, std::size_t forgotten, std::size_t count, T in, T out) {
        constexpr std::size_t G = kGroup;
        T next[G];
        for (std::size_t i = 0; i < forgotten; i += G, z += G, table += 3 * G) {
            for (std::size_t g = 0; g < G; ++g) next[g] = kept(z[g], table + 3 * g, in);
            for (std::size_t g = 0; g < G; ++g) z[g] = next[g];
        }
        for (std::size_t i = forgotten; i < count; i += G, z += G, table += 3 * G) {
            for (std::size_t g = 0; g < G; ++g) {
                next[g] = mul_add(T(table[3 * g + 2]), out, kept(z[g], table + 3 * g, in));
            }
            for (std::size_t g = 0; g < G; ++g) z[g] = next[g];
        }
        *z += in - out;
    }
    static T kept(T z, const R* row, T in) { return mul_add(T(row[1]), in, mul_add(T(row[0]), z, z)); }

    // Returns what the modes slower than the slowest stored one (infinitely many) would add to the sum, as an
    // addition to that mode. The m-th would have the weight G^m times a nearly linear function of its decay
    // rate. A parabola replaces this function: through its values at the two slowest stored modes, and at
    // rate 0, where a mode is the plain sum. The sum then has a closed form.
    T slow_end(T G, const T* z, std::size_t count, R next_scale, R plain_scale) const {
        const R q = R(q_);
        const T one = T(R(1)), Gq = G * T(q), Gqq = Gq * T(q);
        const T d0 = one - G, factor = G / (d0 * (one - Gq) * (one - Gqq));
        const T modes = mul_add(T(q) * (T(1 + q) - Gqq), z[count - 1], T(next_scale) * z[count - 2]);
        return factor * mul_add(d0, modes, T(plain_scale) * z[count]);
    }

    // Returns x^n for n >= 0.
    static T power(T x, std::size_t n) {
        T result = n % 2 != 0 ? x : T(R(1));
        for (n /= 2; n > 0; n /= 2) {
            x *= x;
            if (n % 2 != 0) result *= x;
        }
        return result;
    }

    // Adds to S (see state_sums()) what the modes z_i with the decay rates p_i contribute: sin(pi a) sum_i
    // p_i^a z_i, a polynomial in v = e^{-a step}. a: the order; e^step: p_i / p_{i+1}.
    template <int N>
    void add_state_tails(const Order (&orders)[N], T (&S)[N]) const {
        constexpr int G = kGroup;
        T chain[N][G], step[N];
        const T* z = state_ + nodes_.state.count - G;
        for (int n = 0; n < N; ++n) {
            const T v = orders[n].powers.down;
            step[n] = (v * v) * (v * v);
            for (int g = 0; g < G; ++g) chain[n][g] = z[g];
        }
        while (z != state_) {
            z -= G;
            for (int g = 0; g < G; ++g) {
                const T mode = z[g];
                for (int n = 0; n < N; ++n) chain[n][g] = mul_add(step[n], chain[n][g], mode);
            }
        }
        for (int n = 0; n < N; ++n) {
            // slow_end() takes long. It is added last, so that the sum over the modes does not wait for it.
            const T v = orders[n].powers.down;
            const T end =
                slow_end(v * T(R(q_)), state_, nodes_.state.count, R(-q_ * q_ * q_ * q_), R(state_plain_));
            const T sum = mul_add(power(v, nodes_.state.count - 1), end, join(chain[n], v));
            S[n] = mul_add(orders[n].sine * power(orders[n].powers.up, nodes_.state.top), sum, S[n]);
        }
    }

    // Returns chain[0] + v chain[1] + v^2 chain[2] + v^3 chain[3]. Pairs are added first, because the longest
    // chain of operations is then one product shorter than in nested form.
    static T join(const T (&chain)[kGroup], T v) {
        return mul_add(v * v, mul_add(v, chain[3], chain[2]), mul_add(v, chain[1], chain[0]));
    }

    T variance(const Order& at) const {
        const T V = variance_head(at);
        return nodes_.state.count > 0 ? V + max(variance_tail(at), T(R(0))) : V;
    }

    // Returns what the modes z_i of past variances, with the decay rates q_i, contribute to V (see
    // variance_sum()): sin^2(pi a) 4^b B(b, b) sum_i q_i^{2a} F_i z_i, a polynomial in e^{-2 a step}. a: the
    // order; b = a + 1; B: the Beta function; F_i: the function F of memory_nodes.hpp at q_i.
    T variance_tail(const Order& at) const {
        constexpr std::size_t G = kGroup;
        const T b = at.b;
        // t0 to t3: coefficients of F as a series in w (memory_nodes.hpp), times t0; factor: 4^b B(b, b) / t0
        const T b1 = b + T(R(1)), b2 = b + T(R(2)), b3 = b + T(R(3));
        const T h1 = b + T(R(0.5)), h3 = b + T(R(1.5)), h5 = b + T(R(2.5));
        const T t0 = h1 * h3 * h5, t1 = T(R(0.5)) * b * (h3 * h5), t2 = T(R(0.375)) * (b * b1) * h5,
                t3 = T(R(0.3125)) * (b * b1) * b2;
        const T factor = gamma_ratio(b) / (b * b1 * (b2 * b3));

        const T v = at.powers.down * at.powers.down;
        const T step = (v * v) * (v * v);
        T chain[G];
        const T* z = variance_ + nodes_.variance.count - G;
        for (std::size_t g = 0; g < G; ++g) chain[g] = z[g];
        std::size_t group = nodes_.variance.count / G - 1;
        for (; group > nodes_.two_terms; --group) {
            z -= G;
            for (std::size_t g = 0; g < G; ++g) chain[g] = mul_add(step, chain[g], z[g]);
        }
        for (std::size_t g = 0; g < G; ++g) chain[g] *= t0;
        const R* w = w_ + group * G;
        for (; group > nodes_.four_terms; --group) {
            z -= G;
            w -= G;
            for (std::size_t g = 0; g < G; ++g) {
                chain[g] = mul_add(step, chain[g], mul_add(t1, T(w[g]), t0) * z[g]);
            }
        }
        for (; group > 0; --group) {
            z -= G;
            w -= G;
            for (std::size_t g = 0; g < G; ++g) {
                const T F = mul_add(mul_add(mul_add(t3, T(w[g]), t2), T(w[g]), t1), T(w[g]), t0);
                chain[g] = mul_add(step, chain[g], F * z[g]);
            }
        }
        const T end = slow_end(v * T(R(q_ * q_)), variance_, nodes_.variance.count,
                               R(-q_ * q_ * q_ * q_ * q_), R(variance_plain_));
        const T sum = mul_add(power(v, nodes_.variance.count - 1), end * t0, join(chain, v));
        const T u = at.powers.up * at.powers.up;
        return (at.sine * at.sine) * factor * (power(u, nodes_.variance.top) * sum);
    }

    // Returns 2 sqrt(pi) Gamma(b + 4) / Gamma(b + 7/2), by a polynomial (memory_constants.hpp).
    static T gamma_ratio(T b) {
        const T t = (b - T(R(kGammaCentre))) * T(R(kGammaScale));
        T sum = T(R(kGammaRatio[0]));
        for (int i = 1; i <= kGammaDegree; ++i) sum = mul_add(sum, t, T(R(kGammaRatio[i])));
        return sum;
    }

    void tabulate() {
        double factorial = 1;
        for (std::size_t j = 1; j <= Nodes::kHead; ++j) {
            factorial *= double(j);
            const bool inside = nodes_.window == 0 || j <= nodes_.window;
            R* const row = head_table_ + 3 * (j - 1);
            row[0] = R(j);
            row[1] = inside ? R(1 / factorial) : R(0);
            row[2] = inside ? R(1 / (factorial * factorial)) : R(0);
        }
        q_ = ::exp(-nodes_.step);
        state_forgotten_ = variance_forgotten_ = 0;
        state_plain_ = variance_plain_ = 0;
        const double pi = 3.14159265358979324, head = double(Nodes::kHead),
                     length = double(ring_length(nodes_));
        for (std::size_t i = 0; i < nodes_.state.count; ++i) {
            const double p = nodes_.node(nodes_.state, i), s = ::log1p(p);
            const double K = -nodes_.step / pi * p * ::exp(-(head + 2) * s);
            fill(state_table_ + 3 * i, p / (1 + p), K, s * length, state_forgotten_);
            // the factor of the plain sum in slow_end(), which uses that sum as the mode with decay rate 0
            state_plain_ = -nodes_.step / pi * p * (1 - q_) * (1 - q_ * q_);
        }
        for (std::size_t i = 0; i < nodes_.variance.count; ++i) {
            const double q = nodes_.node(nodes_.variance, i), s = 2 * ::log1p(q);
            const double K = nodes_.step / (pi * pi) * q * q * 2 / (2 + q) * ::exp(-(head + 1.5) * s);
            fill(variance_table_ + 3 * i, q * (2 + q) / ((1 + q) * (1 + q)), K, s * length,
                 variance_forgotten_);
            w_[i] = R(nodes_.w(i));
            variance_plain_ = nodes_.step / (pi * pi) * q * q * (1 - q_) * (1 - q_ * q_);
        }
        state_forgotten_ -= state_forgotten_ % kGroup;
        variance_forgotten_ -= variance_forgotten_ % kGroup;
    }

    // Fills a row of a table for advance(). From its entry to its exit, a sample decays by e^-decay.
    void fill(R* row, double om, double K, double decay, std::size_t& forgotten) const {
        row[0] = R(-om);
        row[1] = R(K);
        row[2] = nodes_.window > 0 ? R(-K * ::exp(-decay)) : R(0);
        if (nodes_.window == 0 || decay > 40) ++forgotten;
    }

    static std::size_t ring_length(const Nodes& nodes) {
        return nodes.window > Nodes::kHead ? nodes.window - Nodes::kHead : 0;
    }
    static std::size_t history_size(const Nodes& nodes) {
        return 4 * Nodes::kHead + nodes.state.count + 1 + nodes.variance.count + 1 + 2 * ring_length(nodes);
    }
    static std::size_t table_size(const Nodes& nodes) {
        return 3 * nodes.state.count + 4 * nodes.variance.count + 3 * Nodes::kHead;
    }
    template <class U>
    static U* take(U*& next, std::size_t n) {
        U* const block = next;
        next += n;
        return block;
    }

    Nodes nodes_;
    T* history_;
    T* x_;  // the newest 15 samples, newest first; they are stored twice so that they are always contiguous
    T* P_;
    T* state_;     // the modes (decaying sums) of past states x, then their plain sum
    T* variance_;  // the modes (decaying sums) of past variances P, then their plain sum
    // the samples in the modes, as pairs of state x and variance P; the one at ring_position_ leaves next
    T* ring_;
    R* state_table_;  // for each mode of x, the three factors that advance() explains: -om, K and -KW
    R* variance_table_;
    R* w_;           // for each mode of the variances: argument w of the function F (memory_nodes.hpp)
    R* head_table_;  // for j = 1 .. 15: j, 1/j! and 1/j!^2, or j, 0 and 0 if j exceeds the memory's length
    double q_;       // e^{-step}
    double state_plain_, variance_plain_;
    std::size_t state_forgotten_, variance_forgotten_;
    std::size_t head_position_, ring_position_;
    std::uint64_t pushed_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
