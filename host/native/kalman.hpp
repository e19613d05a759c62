// The Kalman filter of a system: x is the mean after the newest sample, P the covariance of the next
// prediction.
#pragma once

#include "linear_system.hpp"

namespace fltea {
namespace track {

// What a filter knows after a sample. Relative to the origin of the samples; S: variance of the innovation.
struct Known {
    double state, state_variance, bias, bias_variance, innovation, S;
};

template <int N>
class Kalman {
  public:
    // Gains are exact for so many samples after a start or a gap, and then one for every kHeld samples.
    enum { kExact = 512, kHeld = RiccatiMap<N>::kSamples };
    // An innovation of more deviations counts as one of so many.
    static constexpr double kClip = 6;

    void start(const System<N>* system, const RiccatiMap<N>* map) {
        start(system, map, system->P0);
        for (int i = 0; i < system->n; ++i) x[i] = 0;
    }
    // With this covariance of the first prediction; x is as it was.
    void start(const System<N>* system, const RiccatiMap<N>* map, const double* covariance) {
        system_ = system;
        map_ = map;
        std::memcpy(P, covariance, sizeof(double) * std::size_t(system->n * system->n));
        exact_ = kExact;
        held_ = 0;
        find_gain();
    }
    // After they have been moved.
    void point_to(const System<N>* system, const RiccatiMap<N>* map) {
        system_ = system;
        map_ = map;
    }

    double innovation(double y) {
        double sum = 0;
        const System<N>& s = *system_;
        s.step(x);
        for (int i = 0; i < s.n; ++i) sum += s.c[i] * x[i];
        return y - sum;
    }

    // The next sample has this innovation; without a measurement `take` is false.
    void go_on(double e, bool take) {
        const System<N>& s = *system_;
        const int n = s.n;
        if (take) {
            const double most = kClip * std::sqrt(S);
            const double used = e > most ? most : e < -most ? -most : e;
            for (int i = 0; i < n; ++i) x[i] += K[i] * used;
        } else if (exact_ == 0) {
            exact_ = kExact;
            held_ = 0;
        }
        if (exact_ > 0) {
            if (take) {
                for (int i = 0; i < n; ++i) {
                    const double share = K[i] * S;
                    double* const row = P + i * n;
                    for (int j = 0; j < n; ++j) row[j] -= share * K[j];
                }
                --exact_;
            }
            note_variances(P);
            s.step_covariance(P);
            find_gain();
        } else if (++held_ == kHeld) {
            held_ = 0;
            map_->apply(P);
            find_gain();
            // Of what is known after a measurement, for the samples until the next gain.
            double after[N * N];
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) after[i * n + j] = P[i * n + j] - K[i] * S * K[j];
            }
            note_variances(after);
        }
    }

    Known known(double e) const {
        const System<N>& s = *system_;
        return Known{dot(s.state, x, s.n), state_variance_, dot(s.bias, x, s.n), bias_variance_, e, S};
    }

    template <typename Io>
    void visit(Io& io) {
        const int n = system_->n;
        io.number(exact_, 0, kExact);
        io.number(held_, 0, kHeld - 1);
        for (int i = 0; i < n; ++i) io.real(x[i], -1e150, 1e150);
        for (int i = 0; i < n * n; ++i) io.real(P[i], -1e300, 1e300);
        io.real(state_variance_, 0, 1e300);
        io.real(bias_variance_, 0, 1e300);
        if (io.sound()) find_gain();
        io.require(S > 0);
    }

    double x[N], P[N * N], K[N], S = 1;

  private:
    static double positive(double value) { return value > 0 ? value : 0; }

    void note_variances(const double* after) {
        const System<N>& s = *system_;
        state_variance_ = positive(form(s.state, after, s.state, s.n));
        bias_variance_ = positive(form(s.bias, after, s.bias, s.n));
    }

    void find_gain() {
        const System<N>& s = *system_;
        for (int i = 0; i < s.n; ++i) K[i] = dot(P + i * s.n, s.c, s.n);
        const double of_prediction = dot(K, s.c, s.n);
        S = (of_prediction > 0 ? of_prediction : 0) + s.R;
        for (int i = 0; i < s.n; ++i) K[i] /= S;
    }

    const System<N>* system_ = nullptr;
    const RiccatiMap<N>* map_ = nullptr;
    int exact_ = 0, held_ = 0;
    double state_variance_ = 0, bias_variance_ = 0;
};

template <int N>
constexpr double Kalman<N>::kClip;

}  // namespace track
}  // namespace fltea
