// A noise model as a linear system (host/fltea/noise/system.py), and a map that advances the covariance of a
// Kalman filter's prediction by many samples at once.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstring>
#include <utility>

namespace fltea {
namespace track {

enum { kMost = 24 };  // largest number of states of a system
// Elements of a covariance that are smaller than this in magnitude are set to 0, because calculating with
// denormal numbers takes a processor a hundred times as long.
constexpr double kNothing = 1e-200;

// A linear system with n states, in arrays with room for N; if N is at most 4, zeros follow the last state.
// Matrices are (n, n), row by row, in the first n * n elements. The states of `pairs` pairs of complex poles
// come first. A sample is the sum of the states with the weights `c`, plus white noise of variance R. The
// published state (the noise without white noise) is the sum with the weights `state`, and the bias is the
// sum with the weights `bias`. If the bias is defined as a mean over the next samples, the noise of these
// samples adds the variance bias_more to its variance.
template <int N>
struct System {
    int n, pairs;
    double a[N], b[N], c[N], state[N], bias[N];
    double Q[N * N], P0[N * N];
    double R;
    double bias_more = 0;

    template <typename Io>
    void visit(Io& io) {
        io.number(n, 0, N);
        io.number(pairs, 0, N / 2);
        if (!io.sound()) return;
        io.require(2 * pairs <= n);
        for (int i = 0; i < n; ++i) {
            io.real(a[i], -1, 1);
            io.real(b[i], -1, 1);
            for (double* one : {c, state, bias}) io.real(one[i], -1e100, 1e100);
        }
        for (int i = 0; i < n * n; ++i) {
            io.real(Q[i], -1e200, 1e200);
            io.real(P0[i], -1e200, 1e200);
        }
        io.real(R, 1e-300, 1e200);
        io.real(bias_more, 0, 1e200);
    }

    // Index of the state that is the offset, or -1 if there is no such state. The offset is the state that
    // may step.
    int offset() const {
        for (int i = n - 1; i >= 2 * pairs; --i) {
            if (a[i] == 1 && c[i] != 0) return i;
        }
        return -1;
    }

    // Number of states over which loops run. If N is greater than 4, this is the number n of states in use.
    // If N is at most 4, it is N itself, a constant with which compilers can unroll the loops; the N - n
    // unused states are zero and do not change the results.
    int width() const { return N <= 4 ? N : n; }

    // Advances a state vector by one sample: x <- A x, with the transition matrix A.
    void step(double* x) const {
        for (int i = 0; i < 2 * pairs; i += 2) {
            const double one = a[i] * x[i] + b[i] * x[i + 1], other = a[i] * x[i + 1] - b[i] * x[i];
            x[i] = one;
            x[i + 1] = other;
        }
        for (int i = 2 * pairs; i < width(); ++i) x[i] *= a[i];
    }

    // Advances a symmetric covariance by one sample: P <- A P A' + Q, with the covariance Q of the noise.
    void step_covariance(double* P) const {
        for (int j = 0; j < 2 * pairs; j += 2) {
            for (int i = 0; i < n; ++i) {
                double* const row = P + i * n;
                const double one = a[j] * row[j] + b[j] * row[j + 1];
                row[j + 1] = a[j] * row[j + 1] - b[j] * row[j];
                row[j] = one;
            }
        }
        for (int i = 0; i < 2 * pairs; i += 2) {
            double *const row = P + i * n, *const next = row + n;
            for (int j = 0; j < n; ++j) {
                const double one = a[i] * row[j] + b[i] * next[j];
                next[j] = a[i] * next[j] - b[i] * row[j];
                row[j] = one;
            }
        }
        for (int i = 0; i < n; ++i) {
            const double of_row = i < 2 * pairs ? 1 : a[i];
            double* const row = P + i * n;
            for (int j = 0; j < 2 * pairs; ++j) row[j] = of_row * row[j] + Q[i * n + j];
            for (int j = 2 * pairs; j < n; ++j) row[j] = of_row * a[j] * row[j] + Q[i * n + j];
            for (int j = 0; j < n; ++j) row[j] = std::fabs(row[j]) < kNothing ? 0 : row[j];
        }
    }
};

inline double dot(const double* u, const double* v, int n) {
    double sum = 0;
    for (int i = 0; i < n; ++i) sum += u[i] * v[i];
    return sum;
}

// Returns the number u' P v for the vectors u, v and the matrix P.
inline double form(const double* u, const double* P, const double* v, int n) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        if (u[i] != 0) sum += u[i] * dot(P + i * n, v, n);
    }
    return sum;
}

// Computes out = X Y, or out = X' Y if `transposed` is set.
inline void product(const double* X, const double* Y, double* out, int n, bool transposed = false) {
    for (int i = 0; i < n; ++i) {
        double* const row = out + i * n;
        for (int j = 0; j < n; ++j) row[j] = 0;
        for (int k = 0; k < n; ++k) {
            const double left = transposed ? X[k * n + i] : X[i * n + k];
            for (int j = 0; j < n; ++j) row[j] += left * Y[k * n + j];
        }
    }
}

// Solves linear equations: Y <- M^-1 Y for `columns` columns, by elimination with pivots. M is overwritten.
// Returns false if M is singular.
inline bool solve(double* M, double* Y, int n, int columns) {
    for (int k = 0; k < n; ++k) {
        int pivot = k;
        for (int i = k + 1; i < n; ++i) {
            if (std::fabs(M[i * n + k]) > std::fabs(M[pivot * n + k])) pivot = i;
        }
        if (!(std::fabs(M[pivot * n + k]) > 0)) return false;
        if (pivot != k) {
            for (int j = k; j < n; ++j) std::swap(M[k * n + j], M[pivot * n + j]);
            for (int j = 0; j < columns; ++j) std::swap(Y[k * columns + j], Y[pivot * columns + j]);
        }
        for (int i = k + 1; i < n; ++i) {
            const double share = M[i * n + k] / M[k * n + k];
            if (share == 0) continue;
            for (int j = k + 1; j < n; ++j) M[i * n + j] -= share * M[k * n + j];
            for (int j = 0; j < columns; ++j) Y[i * columns + j] -= share * Y[k * columns + j];
        }
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int j = 0; j < columns; ++j) {
            double sum = Y[i * columns + j];
            for (int k = i + 1; k < n; ++k) sum -= M[i * n + k] * Y[k * columns + j];
            Y[i * columns + j] = sum / M[i * n + i];
        }
    }
    return true;
}

// Maps the covariance P of a filter's prediction to the covariance 2^kDoublings samples later, which is H +
// B' P (I + G P)^-1 B. The matrices for one sample are B = A' (the transposed transition matrix), G = c c' /
// R and H = Q. The doubling algorithm for the discrete Riccati equation (Anderson, Int. J. Control 28, 1978)
// computes those for 2, 4, 8, … samples from them.
template <int N>
class RiccatiMap {
  public:
    enum { kDoublings = 8, kSamples = 1 << kDoublings };

    // Computes the matrices B, G and H of the map for a system. Returns false if a matrix is singular or a
    // number is not finite.
    bool set(const System<N>& s) {
        const int n = n_ = s.n, size = n * n;
        for (int i = 0; i < size; ++i) B_[i] = 0;
        for (int i = 0; i < n; ++i) B_[i * n + i] = s.a[i];
        for (int i = 0; i < 2 * s.pairs; i += 2) {
            B_[i * n + i + 1] = -s.b[i];
            B_[(i + 1) * n + i] = s.b[i];
        }
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) G_[i * n + j] = s.c[i] * s.c[j] / s.R;
        }
        std::memcpy(H_, s.Q, sizeof(double) * std::size_t(size));
        for (int k = 0; k < kDoublings; ++k) {
            double M[N * N], Y[2 * N * N], T[N * N] = {0}, U[N * N] = {0};
            product(G_, H_, M, n);
            for (int i = 0; i < n; ++i) M[i * n + i] += 1;
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) {
                    Y[i * 2 * n + j] = B_[i * n + j];
                    Y[i * 2 * n + n + j] = G_[i * n + j];
                }
            }
            if (!solve(M, Y, n, 2 * n)) return false;
            double WB[N * N], WG[N * N];
            for (int i = 0; i < n; ++i) {
                std::memcpy(WB + i * n, Y + i * 2 * n, sizeof(double) * std::size_t(n));
                std::memcpy(WG + i * n, Y + i * 2 * n + n, sizeof(double) * std::size_t(n));
            }
            product(H_, WB, T, n);
            product(B_, T, U, n, true);
            for (int i = 0; i < size; ++i) H_[i] += U[i];
            product(B_, WG, T, n);
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) G_[i * n + j] += dot(T + i * n, B_ + j * n, n);
            }
            product(B_, WB, T, n);
            std::memcpy(B_, T, sizeof(double) * std::size_t(size));
        }
        for (int i = 0; i < size; ++i) {
            if (!std::isfinite(B_[i] + G_[i] + H_[i])) return false;
        }
        return true;
    }

    // Advances the covariance P by kSamples samples.
    void apply(double* P) const {
        const int n = n_;
        double M[N * N], Y[N * N], T[N * N];
        product(G_, P, M, n);
        for (int i = 0; i < n; ++i) M[i * n + i] += 1;
        std::memcpy(Y, B_, sizeof(double) * std::size_t(n * n));
        if (!solve(M, Y, n, n)) return;
        product(P, Y, T, n);
        product(B_, T, M, n, true);
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) P[i * n + j] = H_[i * n + j] + (M[i * n + j] + M[j * n + i]) / 2;
        }
    }

  private:
    int n_ = 0;
    double B_[N * N], G_[N * N], H_[N * N];
};

}  // namespace track
}  // namespace fltea
