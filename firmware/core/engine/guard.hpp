// Guards of the algorithm's filters. They keep estimates finite and within declared bounds, and count how
// often they had to limit a value.
//
// Every function returns its argument unchanged, bit by bit, if the guard is off or nothing has to be
// limited. alpha is the order (no unit), f the parameter (s^-alpha), gain = h^alpha, and beta = gain f the
// parameter of one step (no unit). Bounds: alpha in [0, 2]; beta in [-2 * 2^alpha, 1], which contains every
// stationary model (-2^alpha < beta < 0) with a margin.
#pragma once

#include "pack_math.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

enum class Guard : int {
    off = 0,       // the paper's algorithm, which may diverge
    faithful = 1,  // the paper's algorithm, with limits on innovations, estimates and state
    // like `faithful`, but the filters of order and parameter also add the variance of the predicted state to
    // the variance of the measurement noise
    consistent = 2
};

// Causes for which an estimate differs from that of the paper's algorithm. In each lane (axis), a cause is
// counted at most once per sample.
enum Cause : int {
    kOrderBox = 0,           // the order left [0, 2]
    kOrderSigma = 1,         // a sigma point of the order left [-1/2, 5/2]
    kOrderVariance = 2,      // the order's predicted variance exceeded 1/3
    kOrderGate = 3,          // the innovation of the order's filter exceeded its limit
    kParameterBox = 4,       // beta = h^alpha f, at the order at which f was stored or used, left its bounds
    kParameterVariance = 5,  // the variance of h^alpha f exceeded a third of the squared length of its range
    kParameterGate = 6,      // the innovation of the parameter's filter exceeded its limit
    // the innovation of the state's filter exceeded four standard deviations, or a prediction in a gap
    // exceeded ten times the largest sample
    kStateBound = 7,
    // an order beyond the range of the compressed memory was requested; this is counted even if the guard is
    // off
    kMemoryOrder = 8,
    kCauses = 9
};

template <class T>
inline MaskOf<T> everywhere(bool value) {
    return value ? T(0) == T(0) : T(0) != T(0);
}

template <class T>
class Guards {
  public:
    typedef MaskOf<T> Mask;

    explicit Guards(Guard mode) : mode_(mode), considered_(everywhere<T>(true)) {
        for (int i = 0; i < kCauses; ++i) hit_[i] = everywhere<T>(false);
    }

    bool active() const { return mode_ != Guard::off; }
    bool consistent() const { return mode_ == Guard::consistent; }

    // From this call on, limited values are counted only for the lanes (axes) in `mask`, because the results
    // of all other lanes are not used.
    void consider(Mask mask) { considered_ = mask; }

    void note(Cause cause, Mask mask) { hit_[cause] = hit_[cause] | (mask & considered_); }

    // Adds what was limited in this step to the counters `count`. Each lane has a counter for each of the
    // kCauses causes.
    void finish(T* count) const {
        for (int i = 0; i < kCauses; ++i) count[i] = count[i] + select(hit_[i], T(1), T(0));
    }

    T order(T alpha) { return active() ? clip(alpha, T(0), T(2), kOrderBox) : alpha; }

    // Limits a sigma point of the order to [-1/2, 5/2], which is wider than the bounds of the order itself,
    // [0, 2]. Near a bound, the narrower limits would clip one of the two outer points and not the other, and
    // the mean of the points would move inwards.
    T order_point(T alpha) { return active() ? clip(alpha, T(-0.5), T(2.5), kOrderSigma) : alpha; }

    // Limits the variance of the order to 1/3. With this variance, the sigma points are at a distance of 1
    // from the mean.
    T order_variance(T P) { return active() ? limit(P, T(1.0 / 3.0), kOrderVariance) : P; }

    // Limits f so that beta = h^alpha f stays within its bounds at the order `alpha`. `scale`: h^alpha and
    // its reciprocal.
    T parameter(T f, T alpha, const Powers<T>& scale) {
        if (!active()) return f;
        const T beta = scale.up * f;
        if (plainly_within(beta, alpha)) return f;
        const T lowest = lowest_beta(alpha);
        const Mask below = beta<lowest, above = beta> T(1);
        note(kParameterBox, below | above);
        return select(below, lowest * scale.down, select(above, scale.down, f));
    }

    // Limits beta, for filters that estimate beta instead of f.
    T beta(T beta, T alpha) {
        if (!active() || plainly_within(beta, alpha)) return beta;
        return clip(beta, lowest_beta(alpha), T(1), kParameterBox);
    }

    // Limits the variance P of f = beta * unit. No sigma point of beta is then farther from the mean than the
    // length of beta's whole range.
    T parameter_variance(T P, T alpha, T unit) {
        if (!active()) return P;
        if (Lanes<T>::count == 1 && all((alpha >= T(0)) & (P <= T(3) * (unit * unit)))) return P;
        const T range = (T(1) - lowest_beta(alpha)) * unit;
        return limit(P, range * range * T(1.0 / 3.0), kParameterVariance);
    }

    // If the innovation e exceeds `gate` times its standard deviation, increases the measurement variance R
    // of the order's or the parameter's filter until it does not. `Pyy`: variance of the innovation, which
    // includes R.
    T gated_noise(T R, T Pyy, T e, T gate, Cause cause) {
        if (!active()) return R;
        const T e2 = e * e, gate2 = gate * gate;
        const Mask beyond = e2 > gate2 * Pyy;
        note(cause, beyond);
        return select(beyond, R + (e2 / gate2 - Pyy), R);
    }

    // If the innovation e exceeds four standard deviations, raises the predicted variance P of the state
    // until it does not. After the update, the distance of the state x from the sample y is at most 4
    // sqrt(R), whatever alpha and f are.
    T state_variance(T P, T R, T e) {
        if (!active()) return P;
        const T e2 = e * e;
        const Mask beyond = e2 > T(16) * (P + R);
        note(kStateBound, beyond);
        return select(beyond, e2 * T(1.0 / 16.0) - R, P);
    }

    // Limits a prediction in a gap to ten times `reach`, which is about the largest sample before the gap.
    // Nothing else limits a prediction while no measurements come.
    void prediction(T& x, T& P, T reach) {
        if (!active()) return;
        const T most = T(10) * reach;
        x = clip(x, -most, most, kStateBound);
        P = limit(P, most * most, kStateBound);
    }

  private:
    // A quick test whether beta = h^alpha f is within its bounds: for alpha >= 0, the lower bound is -2 or
    // less. If the result is false, beta has to be compared with lowest_beta(), which computes an
    // exponential. For SIMD packs the result is always false.
    static bool plainly_within(T beta, T alpha) {
        return Lanes<T>::count == 1 && all((alpha >= T(0)) & (beta >= T(-2)) & (beta <= T(1)));
    }

    static T lowest_beta(T alpha) { return T(-2) * exp(alpha * T(0.69314718055994531)); }

    T clip(T value, T low, T high, Cause cause) {
        const Mask below = value<low, above = value> high;
        note(cause, below | above);
        return select(below, low, select(above, high, value));
    }

    T limit(T value, T high, Cause cause) {
        const Mask above = value > high;
        note(cause, above);
        return select(above, high, value);
    }

    Guard mode_;
    Mask considered_;
    Mask hit_[kCauses];
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
