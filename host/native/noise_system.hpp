// Functions for the linear system of one noise model. They append a state to the system, and compute how well
// its states and the sums of future samples are known (host/fltea/noise/system.py, heading.py).
#pragma once

#include <cstdint>
#include <cstring>

#include "linear_system.hpp"

namespace fltea {
namespace track {

// A state to be appended to a system. Its evolution does not depend on other states. `variance`: variance of
// the state before the first sample. `shared`: the part of this variance that comes from a component which
// the previous state has, too, but with the opposite sign. The component cancels in the sum of both states.
struct Coordinate {
    double a, q, variance, signal, shared;
};

// Appends a state to the system `s`, whose arrays must have room for it.
inline void append(System<kMost>& s, const Coordinate& one) {
    const int n = s.n, all = n + 1;
    for (double* matrix : {s.Q, s.P0}) {
        for (int i = n - 1; i >= 0; --i) {
            for (int j = n - 1; j >= 0; --j) matrix[i * all + j] = matrix[i * n + j];
            matrix[i * all + n] = 0;
        }
        for (int j = 0; j < n; ++j) matrix[n * all + j] = 0;
    }
    s.n = all;
    s.a[n] = one.a;
    s.b[n] = 0;
    s.c[n] = 1;
    s.state[n] = one.signal;
    s.bias[n] = one.a == 1 || one.q == 0 ? 1 : one.signal;
    s.Q[n * all + n] = one.q;
    s.P0[n * all + n] = one.variance;
    if (one.shared == 0 || n == 0) return;
    s.P0[(n - 1) * all + n - 1] += one.shared;
    s.P0[(n - 1) * all + n] = s.P0[n * all + n - 1] = -one.shared;
}

// Writes the transition matrix A of a system, row by row, with n numbers in a row.
template <int N>
void transition(const System<N>& s, double* A) {
    const int n = s.n;
    for (int i = 0; i < n * n; ++i) A[i] = 0;
    for (int i = 0; i < n; ++i) A[i * n + i] = s.a[i];
    for (int i = 0; i < 2 * s.pairs; i += 2) {
        A[i * n + i + 1] = s.b[i];
        A[(i + 1) * n + i] = -s.b[i];
    }
}

// Computes out = X Y' for two matrices.
inline void times_transposed(const double* X, const double* Y, double* out, int n) {
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) out[i * n + j] = dot(X + i * n, Y + j * n, n);
    }
}
inline void make_symmetric(double* X, int n) {
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < i; ++j) X[i * n + j] = X[j * n + i] = (X[i * n + j] + X[j * n + i]) / 2;
    }
}

// Computes the covariance P of the state x after `samples` samples at rest, counted from the very first
// sample. Each step of the computation doubles the number of samples (as RiccatiMap in linear_system.hpp
// does). Returns false if a matrix is singular or a number is not finite.
inline bool rested(const System<kMost>& s, std::int64_t samples, double* P) {
    enum { kSize = kMost * kMost };
    const int n = s.n, size = n * n;
    double A[kSize], G[kSize], H[kSize], M[kSize], Y[2 * kSize], left[kSize], right[kSize], T[kSize],
        U[kSize];
    transition(s, A);
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) G[i * n + j] = s.c[i] * s.c[j] / s.R;
    }
    std::memcpy(H, s.Q, sizeof(double) * std::size_t(size));
    std::memcpy(P, s.P0, sizeof(double) * std::size_t(size));
    for (std::int64_t count = samples - 1; count > 0; count >>= 1) {
        if (count & 1) {
            product(G, P, M, n);
            for (int i = 0; i < n; ++i) M[i * n + i] += 1;
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) Y[i * n + j] = A[j * n + i];
            }
            if (!solve(M, Y, n, n)) return false;
            product(A, P, T, n);
            product(T, Y, U, n);
            for (int i = 0; i < size; ++i) P[i] = H[i] + U[i];
            make_symmetric(P, n);
        }
        product(H, G, M, n);
        for (int i = 0; i < n; ++i) M[i * n + i] += 1;
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                Y[i * 2 * n + j] = A[i * n + j];
                Y[i * 2 * n + n + j] = H[i * n + j];
            }
        }
        if (!solve(M, Y, n, 2 * n)) return false;
        for (int i = 0; i < n; ++i) {
            std::memcpy(left + i * n, Y + i * 2 * n, sizeof(double) * std::size_t(n));
            std::memcpy(right + i * n, Y + i * 2 * n + n, sizeof(double) * std::size_t(n));
        }
        product(A, G, T, n, true);
        product(T, left, U, n);
        for (int i = 0; i < size; ++i) G[i] += U[i];
        product(A, right, T, n);
        times_transposed(T, A, U, n);
        for (int i = 0; i < size; ++i) H[i] += U[i];
        product(A, left, T, n);
        std::memcpy(A, T, sizeof(double) * std::size_t(size));
        make_symmetric(G, n);
        make_symmetric(H, n);
    }
    double gain[kMost];
    for (int i = 0; i < n; ++i) gain[i] = dot(P + i * n, s.c, n);
    const double S = dot(gain, s.c, n) + s.R;
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) P[i * n + j] -= gain[i] * gain[j] / S;
    }
    return true;
}

// Prediction of the sum of the next samples. Each sample is c x plus white noise of variance R. The expected
// sum is the scalar product of `row` and the state x at the last sample. `variance` is the variance that the
// noise of the next samples adds to the sum.
struct SumAhead {
    double row[kMost], variance;
};

// Predicts the sum of the next samples for several numbers of samples together, because all predictions need
// the same squares of the transition matrix.
inline void sums_ahead(const System<kMost>& s, const double* c, double R, const std::int64_t* counts,
                       int count, SumAhead* to) {
    enum { kAll = kMost + 1 };
    // The sum of the samples is appended to the system as its last state.
    const int n = s.n, all = n + 1;
    double A[kMost * kMost], F[kAll * kAll] = {0}, Q[kAll * kAll] = {0}, T[kAll * kAll], U[kAll * kAll];
    transition(s, A);
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            F[i * all + j] = A[i * n + j];
            Q[i * all + j] = s.Q[i * n + j];
            F[n * all + j] += c[i] * A[i * n + j];
            Q[n * all + j] += c[i] * s.Q[i * n + j];
        }
    }
    for (int j = 0; j < n; ++j) Q[j * all + n] = Q[n * all + j];
    F[n * all + n] = 1;
    Q[n * all + n] = dot(Q + n * all, c, n) + R;
    std::int64_t most = 0;
    double rows[kAll];
    for (int k = 0; k < count; ++k) most = counts[k] > most ? counts[k] : most;
    for (int k = 0; k < count; ++k) {
        for (int i = 0; i < n; ++i) to[k].row[i] = 0;
        to[k].variance = 0;
    }
    for (int bit = 0; (most >> bit) > 0; ++bit) {
        for (int k = 0; k < count; ++k) {
            if (((counts[k] >> bit) & 1) == 0) continue;
            std::memcpy(rows, to[k].row, sizeof(double) * std::size_t(n));
            rows[n] = 1;  // weight of the last state, which is the sum of the samples until then
            to[k].variance += form(rows, Q, rows, all);
            for (int j = 0; j < n; ++j) {
                double sum = 0;
                for (int i = 0; i < all; ++i) sum += rows[i] * F[i * all + j];
                to[k].row[j] = sum;
            }
        }
        product(F, Q, T, all);
        times_transposed(T, F, U, all);
        for (int i = 0; i < all * all; ++i) Q[i] += U[i];
        product(F, F, T, all);
        std::memcpy(F, T, sizeof(double) * std::size_t(all * all));
    }
}

}  // namespace track
}  // namespace fltea
