// The three filters of the paper's algorithm for one state (Macias & Sierociuk 2023, section 5), one step at
// a time.
//
//     x_k = h^alpha (f x_{k-1} + u_{k-1}) - sum_{j=1}^{L(k)} c_j(alpha) x_{k-j} + noise of variance Q
//     y_k = x_k + noise of variance R
//
// Here x is the state, y the measured sample, alpha the order, f the parameter, u a known input, and h the
// sampling period. c_j are the weights of a fractional difference, and L(k) past states are in the memory. T
// is float, double, or a pack of several lanes; a lane is one axis. All lanes run through the same operations
// without branches, so one lane cannot influence another. The order of operations is that of
// host/fltea/lab/reference/filters.py, so that results agree to rounding. Compile with -ffp-contract=off.
// Otherwise the compiler may fuse a multiplication and an addition in one place and not in another, and
// results with a guard and without a guard would differ in their last digits.
#pragma once

#include "guard.hpp"
#include "memory_constants.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// One sample of every lane (axis). A lane that is marked in `missing` has no measurement, and its y is
// ignored.
template <class T>
struct Sample {
    T y;  // measurement y_k [deg/s]
    T u;  // input u_{k-1}, times its factor B [deg/s s^-alpha]
    MaskOf<T> missing;
};

// All settings of the filters of a lane (axis). Units: y in deg/s, h in s, f in s^-alpha; variances in the
// squares of these units. KFx filters the state, KFo the order alpha, KFw the parameter f.
template <class T>
struct Tuning {
    T log_h;
    // settings of the state's filter KFx; Q is the variance of a whole step, including the factor h^2alpha
    T x0, P0, Q, R;
    T alpha0, order_P0, order_Q0;  // settings of KFo
    T order_R, order_delta;
    // settings of the parameter's filter KFw; the variant `joint` estimates beta = h^alpha f in place of f,
    // so it has the first beta and the variances of beta here
    T f0, parameter_P0, parameter_Q0;
    T parameter_R, parameter_delta;
    T gate;  // the guard limits innovations that are larger than this [standard deviations]
};

// The estimate of the state x, its variance P, and V, the weighted sum of past variances, all at the last
// sample. `reach` limits predictions. It is the largest |y| so far, plus the inputs during gaps and the
// uncertainty of x at the start.
template <class T>
struct StateBelief {
    T x, P, V, reach;
};

// The order alpha or the parameter f. The filters assume that it does a random walk. The members are its
// estimate, the variance of this estimate, and the variance of one step of the walk.
template <class T>
struct Walk {
    T mean, P, Q;
};

template <class T>
struct Estimate {
    T alpha, alpha_variance, f, f_variance, x, P, innovation, innovation_variance;
};

// What one measurement makes of the estimate of the order or of the parameter f.
template <class T>
struct Update {
    T correction;  // gain K times innovation e
    T P;
};

// Returns point - mean for a sigma point that was computed as mean + step and perhaps clipped. If the point
// was not clipped, `step` is returned. A subtraction would contain the rounding error of the sum, and the
// variances would drift: in float, by a third within a million samples.
template <class T>
T deviation(T point, T mean, T step) {
    return select(point == mean + step, step, point - mean);
}

// The unscented measurement update of the order or of f (the paper, sections 5.1 and 5.3). `points`: the
// sigma points, the first of which is `mean`, and the others `step` away. `Y`: the sample that the model
// predicts at each of them. `R`: variance of the measurement noise. If the innovation exceeds `gate` standard
// deviations, the guard enlarges R and counts `cause`.
template <class T>
Update<T> unscented_update(T mean, T step, const T (&points)[3], const T (&Y)[3], T y, T R, T gate,
                           Guards<T>& guards, Cause cause) {
    const T Wm0 = T(2.0 / 3.0), Wc0 = T(8.0 / 3.0), W = T(1.0 / 6.0);
    const T y_mean = Wm0 * Y[0] + W * Y[1] + W * Y[2];
    const T dy0 = Y[0] - y_mean, dy1 = Y[1] - y_mean, dy2 = Y[2] - y_mean;
    // points[0] is the mean itself, so it adds nothing to the covariance from which the gain K is computed.
    const T dx1 = deviation(points[1], mean, step), dx2 = deviation(points[2], mean, -step);
    const T wy0 = Wc0 * dy0, wy1 = W * dy1, wy2 = W * dy2;
    const T e = y - y_mean;
    const T spread = dy0 * wy0 + dy1 * wy1 + dy2 * wy2;
    R = guards.gated_noise(R, spread + R, e, gate, cause);
    const T K = (dx1 * wy1 + dx2 * wy2) / (spread + R);
    // This form of the estimate's variance equals the paper's P - K Pyy K (K: gain, Pyy: variance of the
    // innovation), but rounding cannot make it negative.
    const T left0 = -(dy0 * K), left1 = dx1 - dy1 * K, left2 = dx2 - dy2 * K;
    Update<T> update;
    update.correction = K * e;
    update.P = left0 * (Wc0 * left0) + left1 * (W * left1) + left2 * (W * left2) + K * R * K;
    return update;
}

// Sets the three sigma points of a scalar with the variance P (n + lambda = 3): mean, mean + sqrt(3 P) and
// mean - sqrt(3 P). Returns sqrt(3 P).
template <class T>
T sigma_points(T mean, T P, T (&points)[3]) {
    const T root = sqrt(P) * T(1.7320508075688772);
    points[0] = mean;
    points[1] = mean + root;
    points[2] = mean - root;
    return root;
}

// Returns the new variance Q of the steps of a random walk (Robbins-Monro). It is a weighted mean of the old
// Q and the square of `correction`, the change of the estimate by the newest sample. `delta`: weight of this
// square.
template <class T>
T adapted(T Q, T delta, T correction) {
    return (T(1) - delta) * Q + delta * (correction * correction);
}

// Whether a memory of past states supports every order that the filters ask for. Most memories do: they have
// no limits, or the same limits as guard.hpp (memory_fixed.hpp). CompressedMemory does not: it replaces an
// order beyond its range by the nearest one in its range, which note_order() counts.
template <class T>
class CompressedMemory;
template <class Memory>
struct AnyOrder {
    static constexpr bool value = true;
};
template <class T>
struct AnyOrder<CompressedMemory<T>> {
    static constexpr bool value = false;
};

// Counts the lanes (axes) in which the memory does not support `order` and takes the nearest order that it
// does support. `lowest`: lowest order that it supports for the sum in question (kLowestOrder for a sum of
// states, kLowestVarianceOrder for a sum of variances).
template <class Memory, class T>
void note_order(T order, T lowest, Guards<T>& guards) {
    typedef Real<T> R;
    if (AnyOrder<Memory>::value) return;
    guards.note(kMemoryOrder, (order < lowest) | (order > T(R(kHighestOrder))));
}

// State at the next sample, as the state's filter KFx predicts it (the paper, section 5.2). x is the
// predicted state, and P its variance.
template <class T>
struct Prediction {
    T x, P;
};

template <class T>
Prediction<T> predict_state(const StateBelief<T>& state, T alpha, T beta, T rate, T past, T V, T Q) {
    const T F = beta + alpha;
    Prediction<T> prediction;
    prediction.x = rate - past;
    prediction.P = F * state.P * F + Q + V;
    return prediction;
}

// Measurement update of the state's filter KFx (the paper, section 5.2). Also writes the results to `out`. If
// the sample is missing, the new state is the prediction. `drive`: the input h^alpha u. While samples are
// missing, the guard limits the predicted state to a multiple of `reach`, which grows by |drive| at each of
// them.
template <class T>
void update_state(StateBelief<T>& state, Prediction<T> at, T V, T drive, const Sample<T>& sample,
                  const Tuning<T>& p, Guards<T>& guards, Estimate<T>& out) {
    const MaskOf<T> missing = sample.missing;
    state.reach = select(missing, state.reach + abs(drive), max(state.reach, abs(sample.y)));
    Prediction<T> held = at;
    if (any(missing)) {
        guards.consider(missing);
        guards.prediction(held.x, held.P, state.reach + T(4) * sqrt(p.R) + sqrt(p.Q));
    }

    guards.consider(!missing);
    const T e = sample.y - at.x;
    const T P = guards.state_variance(at.P, p.R, e);
    const T S = P + p.R;
    const T K = P / S;
    const T kept = T(1) - K;
    state.x = select(missing, held.x, at.x + K * e);
    state.P = select(missing, held.P, kept * P * kept + K * p.R * K);
    state.V = V;
    out.x = state.x;
    out.P = state.P;
    out.innovation = select(missing, T(Real<T>(__builtin_nan(""))), e);
    out.innovation_variance = select(missing, held.P + p.R, S);
}

// Estimates the order, the parameter f and the state with three filters, KFo, KFw and KFx (the paper, section
// 5).
template <class T>
struct Triple {
    StateBelief<T> state;
    Walk<T> order, parameter;

    void start(const Tuning<T>& p) {
        order.mean = p.alpha0, order.P = p.order_P0, order.Q = p.order_Q0;
        parameter.mean = p.f0, parameter.P = p.parameter_P0, parameter.Q = p.parameter_Q0;
    }

    template <class Memory>
    void step(const Memory& memory, const Sample<T>& sample, const Tuning<T>& p, Guards<T>& guards,
              Estimate<T>& out) {
        const MaskOf<T> missing = sample.missing;
        guards.consider(!missing);
        const T order_P = guards.order_variance(order.P + order.Q);
        const Walk<T> moved = order_filter(memory, sample, p, guards, order_P);
        // Q is the variance of the order's change from one measurement to the next. A missing sample
        // therefore changes neither the order's estimate nor its variances.
        order.mean = select(missing, order.mean, moved.mean);
        order.P = select(missing, order.P, moved.P);
        order.Q = select(missing, order.Q, moved.Q);

        guards.consider(everywhere<T>(true));
        const T alpha = order.mean;
        const Powers<T> scale = exp_both(alpha * p.log_h);
        const T gain = scale.up;
        note_order<Memory>(alpha, T(Real<T>(kLowestVarianceOrder)), guards);
        T past, V;
        memory.sums(alpha, past, V);
        V = max(V, T(0));  // weighted sum of past variances, which rounding can make slightly negative
        // The state's filter KFx uses the estimate of the parameter f as it was before this sample.
        const T f = guards.parameter(parameter.mean, alpha, scale);
        const T rate = gain * (f * state.x + sample.u);
        const Prediction<T> at = predict_state(state, alpha, gain * f, rate, past, V, p.Q);

        // The filter KFw estimates the parameter f (the paper, section 5.3). It puts three sigma points of f
        // into the same model, at the order that was just estimated.
        const T P = guards.parameter_variance(parameter.P + parameter.Q, alpha, scale.down);
        guards.consider(!missing);
        T points[3], Y[3];
        const T step = sigma_points(f, P, points);
        for (int i = 0; i < 3; ++i) Y[i] = gain * (points[i] * state.x + sample.u) - past;
        const T R = guards.consistent() ? p.parameter_R + at.P : p.parameter_R;
        const Update<T> update =
            unscented_update(f, step, points, Y, sample.y, R, p.gate, guards, kParameterGate);
        const T proposed = f + update.correction;
        const T mean = guards.parameter(proposed, alpha, scale);
        const T correction = learnt(update.correction, proposed, mean, f);
        parameter.Q = select(missing, parameter.Q, adapted(parameter.Q, p.parameter_delta, correction));
        parameter.mean = select(missing, f, mean);
        parameter.P = select(missing, parameter.P, update.P);

        update_state(state, at, V, gain * sample.u, sample, p, guards, out);
        out.alpha = order.mean;
        out.alpha_variance = order.P;
        out.f = parameter.mean;
        out.f_variance = parameter.P;
    }

  private:
    // The filter KFo estimates the order from the model's outputs at three sigma points of the order (the
    // paper, section 5.1).
    template <class Memory>
    Walk<T> order_filter(const Memory& memory, const Sample<T>& sample, const Tuning<T>& p, Guards<T>& guards,
                         T P) const {
        T points[3], past[3], Y[3];
        const T step = sigma_points(order.mean, P, points);
        for (int i = 1; i < 3; ++i) points[i] = guards.order_point(points[i]);
        for (int i = 0; i < 3; ++i) note_order<Memory>(points[i], T(Real<T>(kLowestOrder)), guards);
        memory.state_sums(points, past);
        T R = p.order_R;
        for (int i = 0; i < 3; ++i) {
            const Powers<T> scale = exp_both(points[i] * p.log_h);
            const T gain = scale.up;
            const T f = guards.parameter(parameter.mean, points[i], scale);
            Y[i] = gain * (f * state.x + sample.u) - past[i];
            if (i == 0 && guards.consistent()) {
                // The measurement variance also includes the uncertainty of what the paper's filter treats as
                // exact: the previous state, the noise of its step, and its past.
                const T F = gain * f + order.mean;
                R = R + (F * state.P * F + p.Q + state.V);
            }
        }
        const Update<T> update =
            unscented_update(order.mean, step, points, Y, sample.y, R, p.gate, guards, kOrderGate);
        const T proposed = order.mean + update.correction;
        Walk<T> moved;
        moved.mean = guards.order(proposed);
        moved.P = update.P;
        moved.Q =
            adapted(order.Q, p.order_delta, learnt(update.correction, proposed, moved.mean, order.mean));
        return moved;
    }

    // Returns the correction that remained after the guard had limited it. Q is adapted to this correction.
    static T learnt(T correction, T proposed, T made, T before) {
        return select(made == proposed, correction, made - before);
    }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
