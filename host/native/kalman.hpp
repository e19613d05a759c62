// The Kalman filter of a linear system. x is the estimate of the state after the newest sample, and P the
// covariance of the error of the state that is predicted for the next sample.
#pragma once

#include "linear_system.hpp"

namespace fltea {
namespace track {

// Estimates after a sample. They are relative to the origin, which is subtracted from all samples. S:
// variance of the innovation.
struct Known {
    double state, state_variance, bias, bias_variance, innovation, S;
};

// The logarithm of the innovation's variance S. As long as the filter uses the same gain, S stays the same,
// so the logarithm is computed only when S changes.
class HeldLog {
  public:
    double of(double S) {
        if (S != S_) {
            S_ = S;
            log_ = std::log(S);
        }
        return log_;
    }

  private:
    double S_ = 1, log_ = 0;
};

template <int N>
class Kalman {
  public:
    struct Variances {
        double state, bias;
    };
    // Values for one sample: the gain K, the variance S of the innovation and its logarithm, and the
    // variances of the estimates after the sample.
    struct Gain {
        double K[N], S, log_S;
        Variances now;
    };
    // Gains of the filter of a system for the first kExact samples after the filter's start. `at` points to
    // the gain for the first sample, and the gains for the next samples follow at distances of `stride`. P is
    // the covariance of the prediction for the last of the kExact samples. The gains do not depend on the
    // samples, so all filters of the same system share them.
    struct Gains {
        const Gain* at;
        std::size_t stride;
        double P[N * N];
    };

    // For kExact samples after a start or a gap, the filter computes the exact gain for each sample. After
    // that, it uses one gain for the next kHeld samples: the gain that is exact for the last of them.
    enum { kExact = 512, kHeld = RiccatiMap<N>::kSamples, kStep = 32 };
    // Innovations are clipped at this number of standard deviations.
    static constexpr double kClip = 6;

    Kalman() {}
    Kalman(const Kalman& other) { *this = other; }
    Kalman& operator=(const Kalman& other) {
        system_ = other.system_;
        map_ = other.map_;
        exact_ = other.exact_;
        held_ = other.held_;
        now_ = other.now_;
        from_ = other.from_;
        to_ = other.to_;
        gains_ = other.gains_;
        S = other.S;
        if (system_ == nullptr) return *this;
        const std::size_t n = std::size_t(system_->n), all = std::size_t(system_->width());
        std::memcpy(x, other.x, all * sizeof(double));
        std::memcpy(K, other.K, all * sizeof(double));
        if (gains_ == nullptr) std::memcpy(P, other.P, n * n * sizeof(double));
        return *this;
    }

    // `gains`: the precomputed gains of this system, or null.
    void start(const System<N>* system, const RiccatiMap<N>* map, const Gains* gains = nullptr) {
        start(system, map, system->P0);
        gains_ = gains;
        for (int i = 0; i < system->n; ++i) x[i] = 0;
    }
    static void find_gains(const System<N>& system, const RiccatiMap<N>& map, Gain* at, Gains& gains) {
        Kalman one;
        one.start(&system, &map);
        for (std::size_t k = 0; k < kExact; ++k) {
            Gain& gain = at[k * gains.stride];
            std::memcpy(gain.K, one.K, sizeof one.K);
            gain.S = one.S;
            gain.log_S = std::log(one.S);
            gain.now = one.now_;
            std::memcpy(gains.P, one.P, sizeof one.P);
            one.go_on(0, true);
        }
        gains.at = at;
    }
    // Starts the filter again, with `covariance` as the covariance of the first prediction. The estimate x is
    // kept.
    void start(const System<N>* system, const RiccatiMap<N>* map, const double* covariance) {
        system_ = system;
        map_ = map;
        std::memcpy(P, covariance, sizeof(double) * std::size_t(system->n * system->n));
        gains_ = nullptr;
        exact_ = kExact;
        held_ = 0;
        find_gain();
    }
    double bias() const { return dot(system_->bias, x, system_->n); }
    // Variance of the scalar product of `row` and x. It is computed from the covariance P. While the gain is
    // held (hold()), P is not the present covariance, but that of a sample up to kHeld samples later. The
    // change of the bias's variance until then is known, and is used to correct the result.
    double variance_of(const double* row) const {
        const System<N>& s = *system_;
        const double own = form(row, P, row, s.n), of_bias = form(s.bias, P, s.bias, s.n);
        const double found = own + now_.bias - of_bias;
        return found > 0 ? found : own > 0 ? own : 0;
    }

    // Sets new addresses of the system and of its RiccatiMap. Call this after the two objects have been moved
    // in memory.
    void point_to(const System<N>* system, const RiccatiMap<N>* map) {
        system_ = system;
        map_ = map;
    }

    double innovation(double y) {
        double sum = 0;
        const System<N>& s = *system_;
        s.step(x);
        for (int i = 0; i < s.width(); ++i) sum += s.c[i] * x[i];
        return y - sum;
    }

    // Advances by one sample, whose innovation is `e`. If `take` is false, the sample is missing.
    void go_on(double e, bool take) {
        const int n = system_->n;
        if (take) {
            const double used = e * e > kClip * kClip * S ? std::copysign(kClip * std::sqrt(S), e) : e;
            for (int i = 0; i < system_->width(); ++i) x[i] += K[i] * used;
            if (exact_ == 0) {
                hold_on();
                return;
            }
            if (gains_ != nullptr) {
                if (exact_ > 1) {
                    --exact_;
                    use(gain());
                    return;
                }
                std::memcpy(P, gains_->P, sizeof(double) * std::size_t(n * n));
                gains_ = nullptr;
            }
            correct();
            --exact_;
        } else {
            find_covariance();
            if (exact_ == 0) let_go();
            for (int i = 0; i < n; ++i) x[i] = std::fabs(x[i]) < kNothing ? 0 : x[i];
        }
        now_ = variances(P);
        system_->step_covariance(P);
        find_gain();
        if (exact_ == 0) hold();
    }

    // Notes that state i may change before the next sample by an unknown amount, which has this variance.
    void widen(int i, double variance) {
        find_covariance();
        if (exact_ == 0) let_go();
        P[i * system_->n + i] += variance;
        find_gain();
        exact_ = kExact;
    }

    double log_S(HeldLog& held) const { return gains_ != nullptr ? gain().log_S : held.of(S); }

    Known known(double e) const {
        const System<N>& s = *system_;
        return Known{dot(s.state, x, s.n), now_.state, dot(s.bias, x, s.n), now_.bias + s.bias_more, e, S};
    }

    template <typename Io>
    void visit(Io& io) {
        find_covariance();
        const int n = system_->n;
        io.number(exact_, 0, kExact);
        io.number(held_, 0, kHeld - 1);
        for (int i = 0; i < n; ++i) io.real(x[i], -1e150, 1e150);
        for (int i = 0; i < n * n; ++i) io.real(P[i], -1e300, 1e300);
        for (Variances* one : {&now_, &from_, &to_}) {
            io.real(one->state, 0, 1e300);
            io.real(one->bias, 0, 1e300);
        }
        if (io.sound()) find_gain();
        io.require(S > 0);
    }

    // x, K and S are used for each sample, so they come first in memory.
    double x[N] = {}, K[N] = {}, S = 1;

  private:
    // Updates the covariance P for a sample that was measured.
    void correct() {
        const int n = system_->n;
        for (int i = 0; i < n; ++i) {
            const double share = K[i] * S;
            double* const row = P + i * n;
            for (int j = 0; j < n; ++j) row[j] -= share * K[j];
        }
    }

    const Gain& gain() const { return gains_->at[std::size_t(kExact - exact_) * gains_->stride]; }

    void use(const Gain& one) {
        std::memcpy(K, one.K, sizeof K);
        S = one.S;
        now_ = one.now;
    }

    // Stops using the precomputed gains `gains_`, and computes the present covariance P, which was not
    // updated while they were used.
    void find_covariance() {
        if (gains_ == nullptr) return;
        std::memcpy(P, system_->P0, sizeof(double) * std::size_t(system_->n * system_->n));
        const int left = exact_;
        for (exact_ = kExact; exact_ > left; --exact_) {
            use(gain());
            correct();
            system_->step_covariance(P);
        }
        use(gain());
        gains_ = nullptr;
    }

    Variances variances(const double* of) const {
        const System<N>& s = *system_;
        const double state = form(s.state, of, s.state, s.n), bias = form(s.bias, of, s.bias, s.n);
        return Variances{state > 0 ? state : 0, bias > 0 ? bias : 0};
    }

    void find_gain() {
        const System<N>& s = *system_;
        for (int i = 0; i < s.n; ++i) K[i] = dot(P + i * s.n, s.c, s.n);
        const double of_prediction = dot(K, s.c, s.n);
        S = (of_prediction > 0 ? of_prediction : 0) + s.R;
        for (int i = 0; i < s.n; ++i) K[i] /= S;
    }

    // Begins to use the same gain for the next kHeld samples. From here on, P is the covariance at the end of
    // these samples.
    void hold() {
        const int n = system_->n;
        held_ = 0;
        from_ = now_;
        map_->apply(P);
        find_gain();
        double after[N * N];
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) after[i * n + j] = P[i * n + j] - K[i] * S * K[j];
        }
        to_ = variances(after);
    }

    void hold_on() {
        if (++held_ == kHeld) {
            now_ = to_;
            hold();
        }
        if (held_ % kStep != 0) return;
        // The variances are known at the beginning and at the end of the kHeld samples. In between, 1 /
        // variance is interpolated linearly, because for the estimate of a constant, 1 / variance grows in
        // proportion to the number of samples.
        const double share = double(held_ + kStep / 2) / kHeld;
        now_.state = between(from_.state, to_.state, share);
        now_.bias = between(from_.bias, to_.bias, share);
    }
    static double between(double from, double to, double share) {
        const double whole = to + (from - to) * share;
        return whole > 0 ? from * to / whole : 0;
    }

    // Stops using the same gain for several samples, and computes the present covariance approximately.
    void let_go() {
        const double ahead = to_.bias > 0 ? now_.bias / to_.bias : 1;
        if (ahead > 1) {
            for (int i = 0; i < system_->n * system_->n; ++i) P[i] *= ahead;
        }
        find_gain();
        exact_ = kExact;
    }

    const System<N>* system_ = nullptr;
    const Gains* gains_ = nullptr;  // the precomputed gains, or null; while they are used, P is not updated
    int exact_ = 0, held_ = 0;
    Variances now_ = Variances(), from_ = Variances(), to_ = Variances();
    const RiccatiMap<N>* map_ = nullptr;

  public:
    double P[N * N];
};

template <int N>
constexpr double Kalman<N>::kClip;

}  // namespace track
}  // namespace fltea
