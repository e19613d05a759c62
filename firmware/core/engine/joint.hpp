// The variant "joint" of the algorithm: one unscented filter estimates the order alpha and beta = h^alpha f
// together. It replaces the paper's two separate filters of alpha (KFo) and f (KFw).
//
// Two separate filters have two problems. They ignore the correlation of alpha and f, so their estimates stop
// changing before they reach the true values. And f, which is proportional to h^-alpha, diverges when alpha
// changes. One filter for alpha and beta together has neither problem. Its measurement variance is by default
// the variance of the state's step plus that of the measurement (Q + R).
#pragma once

#include "filters.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Covariance of alpha and beta, a symmetric 2 x 2 matrix.
template <class T>
struct Covariance {
    T aa, ab, bb;
};

template <class T>
struct Joint {
    StateBelief<T> state;
    T alpha, beta;
    Covariance<T> P, Q;

    void start(const Tuning<T>& p) {
        // This filter estimates beta = h^alpha f instead of f. The settings f0, parameter_P0 and parameter_Q0
        // therefore contain the first beta and the variances of beta.
        alpha = p.alpha0, beta = p.f0;
        P.aa = p.order_P0, P.ab = T(0), P.bb = p.parameter_P0;
        Q.aa = p.order_Q0, Q.ab = T(0), Q.bb = p.parameter_Q0;
    }

    template <class Memory>
    void step(const Memory& memory, const Sample<T>& sample, const Tuning<T>& p, Guards<T>& guards,
              Estimate<T>& out) {
        const MaskOf<T> missing = sample.missing;
        guards.consider(!missing);
        const Covariance<T> wide = {P.aa + Q.aa, P.ab + Q.ab, P.bb + Q.bb};
        const Covariance<T> predicted = limited(wide, guards);
        measure(memory, sample, p, guards, predicted);

        guards.consider(everywhere<T>(true));
        const Powers<T> scale = exp_both(alpha * p.log_h);
        const T drive = scale.up * sample.u;
        note_order<Memory>(alpha, T(Real<T>(kLowestVarianceOrder)), guards);
        T past, V;
        memory.sums(alpha, past, V);
        V = max(V, T(0));  // weighted sum of past variances, which rounding can make slightly negative
        const Prediction<T> at = predict_state(state, alpha, beta, beta * state.x + drive, past, V, p.Q);
        update_state(state, at, V, drive, sample, p, guards, out);
        out.alpha = alpha;
        out.alpha_variance = P.aa;
        report(scale.down, p.log_h, out);
    }

  private:
    static const int kPoints = 5;

    // Limits the variances of alpha and beta. Their correlation stays the same.
    Covariance<T> limited(const Covariance<T>& wide, Guards<T>& guards) const {
        if (!guards.active()) return wide;
        const T aa = guards.order_variance(wide.aa);
        const T bb = guards.parameter_variance(wide.bb, alpha, T(1));
        const T scale =
            sqrt(select(wide.aa > aa, aa / wide.aa, T(1))) * sqrt(select(wide.bb > bb, bb / wide.bb, T(1)));
        const Covariance<T> narrow = {aa, wide.ab * scale, bb};
        return narrow;
    }

    // Makes the measurement update of alpha and beta. It uses the model's outputs at five sigma points, which
    // are the mean, and the mean plus and minus each column of sqrt(3 P), with the covariance P of alpha and
    // beta.
    template <class Memory>
    void measure(const Memory& memory, const Sample<T>& sample, const Tuning<T>& p, Guards<T>& guards,
                 const Covariance<T>& at) {
        const T root3 = T(1.7320508075688772), zero = T(0);
        const T l_aa = sqrt(at.aa);
        const T l_ba = select(l_aa > zero, at.ab / l_aa, zero);
        // the part of at.bb that alpha does not explain; rounding can make it negative
        const T rest = at.bb - l_ba * l_ba;
        const T da = root3 * l_aa, dab = root3 * l_ba, db = root3 * sqrt(select(rest < zero, zero, rest));

        T orders[3] = {alpha, guards.order_point(alpha + da), guards.order_point(alpha - da)};
        T past[3], base[3];
        for (int i = 0; i < 3; ++i) note_order<Memory>(orders[i], T(Real<T>(kLowestOrder)), guards);
        memory.state_sums(orders, past);
        const bool driven = any(sample.u != zero);
        for (int i = 0; i < 3; ++i) {
            base[i] = (driven ? exp(orders[i] * p.log_h) * sample.u : zero) - past[i];
        }
        const T da1 = deviation(orders[1], alpha, da), da2 = deviation(orders[2], alpha, -da);

        const T x = state.x;
        const T Y[kPoints] = {beta * x + base[0], (beta + dab) * x + base[1], (beta - dab) * x + base[2],
                              (beta + db) * x + base[0], (beta - db) * x + base[0]};
        const T d_alpha[kPoints] = {zero, da1, da2, zero, zero};
        const T d_beta[kPoints] = {zero, dab, -dab, db, -db};

        const T W = T(1.0 / 6.0), Wm0 = T(1.0 / 3.0), Wc0 = T(7.0 / 3.0);
        T y_mean = Wm0 * Y[0];
        for (int i = 1; i < kPoints; ++i) y_mean = y_mean + W * Y[i];
        T spread = zero, P_ay = zero, P_by = zero, dy[kPoints];
        for (int i = 0; i < kPoints; ++i) {
            dy[i] = Y[i] - y_mean;
            const T weighted = (i == 0 ? Wc0 : W) * dy[i];
            spread = spread + dy[i] * weighted;
            P_ay = P_ay + d_alpha[i] * weighted;
            P_by = P_by + d_beta[i] * weighted;
        }
        T R = p.parameter_R;
        if (guards.consistent()) {
            const T F = beta + alpha;
            R = R + (F * state.P * F + state.V);  // parameter_R already includes Q, the variance of a step
        }
        const T e = sample.y - y_mean;
        R = guards.gated_noise(R, spread + R, e, p.gate, kOrderGate);
        const T S = spread + R, K_a = P_ay / S, K_b = P_by / S;

        Covariance<T> next = {K_a * R * K_a, K_a * R * K_b, K_b * R * K_b};
        for (int i = 0; i < kPoints; ++i) {
            const T Wc = i == 0 ? Wc0 : W;
            const T left_a = d_alpha[i] - K_a * dy[i], left_b = d_beta[i] - K_b * dy[i];
            next.aa = next.aa + left_a * (Wc * left_a);
            next.ab = next.ab + left_a * (Wc * left_b);
            next.bb = next.bb + left_b * (Wc * left_b);
        }
        const T proposed_a = alpha + K_a * e, proposed_b = beta + K_b * e;
        const T made_a = guards.order(proposed_a), made_b = guards.beta(proposed_b, made_a);
        move_to(made_a, made_b, next, p.parameter_delta, sample.missing);
    }

    // Sets alpha and beta = h^alpha f to new values, and P to their covariance. Q becomes a weighted mean of
    // the old Q and the products of the two changes. `delta`: weight of these products. Lanes without a
    // sample keep everything.
    void move_to(T made_a, T made_b, const Covariance<T>& next, T delta, MaskOf<T> missing) {
        const T moved_a = made_a - alpha, moved_b = made_b - beta, kept = T(1) - delta;
        Q.aa = select(missing, Q.aa, kept * Q.aa + delta * (moved_a * moved_a));
        Q.ab = select(missing, Q.ab, kept * Q.ab + delta * (moved_a * moved_b));
        Q.bb = select(missing, Q.bb, kept * Q.bb + delta * (moved_b * moved_b));
        P.aa = select(missing, P.aa, next.aa);
        P.ab = select(missing, P.ab, next.ab);
        P.bb = select(missing, P.bb, next.bb);
        alpha = select(missing, alpha, made_a);
        beta = select(missing, beta, made_b);
    }

    // Computes f = beta h^-alpha and the variance of f. The variance is a first-order approximation: df =
    // h^-alpha (dbeta - beta ln(h) dalpha).
    void report(T unit, T log_h, Estimate<T>& out) const {
        const T slope = beta * log_h;
        const T variance = P.bb - T(2) * slope * P.ab + slope * slope * P.aa;
        out.f = beta * unit;
        out.f_variance = max(variance, T(0)) * (unit * unit);
    }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
