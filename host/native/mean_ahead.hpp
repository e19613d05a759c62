// Computes the expected mean of a weighted sum of states over the next samples. It computes how this mean
// depends on the present states, and which variance the noise of these samples adds to it. The published bias
// is the forecast of such a mean.
#pragma once

#include <complex>

#include "linear_system.hpp"

namespace fltea {
namespace track {

// The expected mean is the scalar product of `row` and x, the state vector at the newest sample. `variance`
// is the variance that the noise of the next samples adds to the mean.
template <int N>
struct MeanAhead {
    double row[N];
    double variance;
};

// Sums over m samples for a mode of the system. A mode is multiplied by a complex number a with each sample.
// The sums are computed by doubling m. For slow modes, all terms have the same sign, so no precision is lost.
// `power`: a^m. `geometric`: g(m) = 1 + a + … + a^(m-1). `sums`: g(1) + g(2) + … + g(m).
struct ModeSums {
    std::complex<double> power, geometric, sums;
};

// Returns the expected mean of the scalar product of `weights` and the state x over the next m samples. If m
// = 0, the result is the scalar product with the present x.
//
// With the transition matrix A, the state j samples ahead is x_k+j = A^j x_k plus noise. The mean is
// therefore computed in the eigenvectors of A, where a pole pair becomes two conjugate modes. For a mode with
// the eigenvalue a, the mean of a^j over j = 1 … m is a g(m) / m (ModeSums), and the noise that is added j
// samples ahead has the weight g(m - j + 1) / m.
template <int N>
MeanAhead<N> mean_ahead(const System<N>& s, const double* weights, long long m) {
    typedef std::complex<double> Complex;
    MeanAhead<N> found;
    found.variance = 0;
    for (int i = 0; i < N; ++i) found.row[i] = i < s.n ? weights[i] : 0;
    if (m <= 0) return found;
    const int n = s.n;
    Complex a[N], weight[N];
    for (int i = 0; i < n; ++i) {
        a[i] = s.a[i];
        weight[i] = weights[i];
    }
    // For a pole pair with the states x and y, the first mode is ξ = x + i y, which is multiplied by a - i b
    // with each sample. The conjugate of ξ is the second mode.
    for (int i = 0; i < 2 * s.pairs; i += 2) {
        a[i] = Complex(s.a[i], -s.b[i]);
        a[i + 1] = std::conj(a[i]);
        weight[i] = Complex(weights[i], -weights[i + 1]) / 2.0;
        weight[i + 1] = std::conj(weight[i]);
    }
    // `both`: for any two modes, the sum of g(k) conj g'(k) over k = 1 … m. Here g (ModeSums::geometric)
    // belongs to one mode and g' to the other.
    Complex both[N * N], noise[N * N];
    ModeSums of[N];
    for (int i = 0; i < n; ++i) {
        of[i] = ModeSums{a[i], 1.0, 1.0};
        for (int j = 0; j < n; ++j) {
            both[i * n + j] = 1.0;
            noise[i * n + j] = s.Q[i * n + j];
        }
    }
    // The covariance of the noise is transformed to the modes: first its rows, then its columns.
    for (int i = 0; i < 2 * s.pairs; i += 2) {
        for (int j = 0; j < n; ++j) {
            const Complex one = noise[i * n + j], other = noise[(i + 1) * n + j];
            noise[i * n + j] = one + Complex(0, 1) * other;
            noise[(i + 1) * n + j] = one - Complex(0, 1) * other;
        }
    }
    for (int i = 0; i < 2 * s.pairs; i += 2) {
        for (int j = 0; j < n; ++j) {
            const Complex one = noise[j * n + i], other = noise[j * n + i + 1];
            noise[j * n + i] = one - Complex(0, 1) * other;
            noise[j * n + i + 1] = one + Complex(0, 1) * other;
        }
    }
    int bit = 0;
    while ((m >> (bit + 1)) > 0) ++bit;
    double count = 1;
    while (bit-- > 0) {
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                const Complex gi = of[i].geometric, gj = std::conj(of[j].geometric), pi = of[i].power,
                              pj = std::conj(of[j].power);
                Complex& sum = both[i * n + j];
                sum +=
                    count * gi * gj + gi * pj * std::conj(of[j].sums) + pi * gj * of[i].sums + pi * pj * sum;
            }
        }
        for (int i = 0; i < n; ++i) {
            ModeSums& one = of[i];
            one.sums += count * one.geometric + one.power * one.sums;
            one.geometric += one.power * one.geometric;
            one.power *= one.power;
        }
        count *= 2;
        if (((m >> bit) & 1) == 0) continue;
        for (int i = 0; i < n; ++i) {
            of[i].geometric = of[i].geometric + of[i].power;
            of[i].power *= a[i];
            of[i].sums += of[i].geometric;
        }
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                both[i * n + j] += of[i].geometric * std::conj(of[j].geometric);
            }
        }
        count += 1;
    }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            found.variance += (weight[i] * std::conj(weight[j]) * noise[i * n + j] * both[i * n + j]).real();
        }
    }
    found.variance = found.variance > 0 ? found.variance / (double(m) * double(m)) : 0;
    for (int i = 0; i < n; ++i) {
        const Complex mean = weight[i] * a[i] * of[i].geometric / double(m);
        if (i >= 2 * s.pairs) {
            found.row[i] = mean.real();
        } else if (i % 2 == 0) {  // a mode ξ and its conjugate together contribute 2 Re(mean ξ)
            found.row[i] = 2 * mean.real();
            found.row[i + 1] = -2 * mean.imag();
        }
    }
    return found;
}

// Considers what the states for which `in` is true contribute to a sample, and returns the spectral density
// of this contribution at frequency 0. If these states are fast, the density gives the variance that they
// contribute to a mean of many samples.
template <int N>
double density_at_zero(const System<N>& s, const bool* in) {
    double M[N * N], row[N];
    for (int i = 0; i < s.n; ++i) {
        row[i] = in[i] ? s.c[i] : 0;
        for (int j = 0; j < s.n; ++j) M[i * s.n + j] = i == j ? (in[i] ? 1 - s.a[i] : 1) : 0;
    }
    for (int i = 0; i < 2 * s.pairs; i += 2) {  // the equations are solved with the transposed matrix
        M[(i + 1) * s.n + i] = -s.b[i];
        M[i * s.n + i + 1] = s.b[i];
    }
    return solve(M, row, s.n, 1) ? form(row, s.Q, row, s.n) : 0;
}

}  // namespace track
}  // namespace fltea
