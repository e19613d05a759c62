// Computes the expected mean of a weighted sum of states over the next samples. It computes how this mean
// depends on the present states, and which variance the noise of these samples adds to it. The published bias
// is the forecast of such a mean.
#pragma once

#include <complex>

#include "linear_system.hpp"

namespace fltea {
namespace track {

// Forecast of a mean over the next samples. The expected mean is the scalar product of `row` and x, the state
// vector at the newest sample. The noise of the next samples adds `variance` to the variance of the mean.
template <int N>
struct MeanAhead {
    double row[N];
    double variance;
};

// A system in the eigenvectors of its matrix A, where a pole pair becomes two conjugate modes. A mode is
// multiplied by its eigenvalue a with each sample.
template <int N>
struct Modes {
    typedef std::complex<double> Complex;

    int n;
    Complex a[N], weight[N];
    Complex noise[N * N];  // covariance of the noise that a sample adds to the modes

    Modes(const System<N>& s, const double* weights) : n(s.n) {
        for (int i = 0; i < n; ++i) {
            a[i] = s.a[i];
            weight[i] = weights[i];
        }
        // For a pole pair with the states x and y, the first mode is ξ = x + i y. Its conjugate is the second
        // mode. Each sample multiplies ξ by a - i b, where a and b are the pair's numbers in s.a and s.b.
        for (int i = 0; i < 2 * s.pairs; i += 2) {
            a[i] = Complex(s.a[i], -s.b[i]);
            a[i + 1] = std::conj(a[i]);
            weight[i] = Complex(weights[i], -weights[i + 1]) / 2.0;
            weight[i + 1] = std::conj(weight[i]);
        }
        for (int i = 0; i < n * n; ++i) noise[i] = s.Q[i];
        transform_noise(s.pairs);
    }

  private:
    // Transforms the covariance of the noise to the modes: first its rows, then its columns.
    void transform_noise(int pairs) {
        for (int i = 0; i < 2 * pairs; i += 2) {
            for (int j = 0; j < n; ++j) {
                const Complex one = noise[i * n + j], other = noise[(i + 1) * n + j];
                noise[i * n + j] = one + Complex(0, 1) * other;
                noise[(i + 1) * n + j] = one - Complex(0, 1) * other;
            }
        }
        for (int i = 0; i < 2 * pairs; i += 2) {
            for (int j = 0; j < n; ++j) {
                const Complex one = noise[j * n + i], other = noise[j * n + i + 1];
                noise[j * n + i] = one - Complex(0, 1) * other;
                noise[j * n + i + 1] = one + Complex(0, 1) * other;
            }
        }
    }
};

// Sums over m samples for all modes of a system. They are computed by doubling m. The formula (1 - a^m) / (1
// - a) would lose precision for slow modes, whose eigenvalue a is near 1. Doubling does not, because all
// terms then have the same sign.
template <int N>
class ModeSums {
  public:
    typedef std::complex<double> Complex;

    ModeSums(const Modes<N>& modes, long long m) : modes_(modes) {
        const int n = modes.n;
        for (int i = 0; i < n; ++i) of_[i] = OfMode{modes.a[i], 1.0, 1.0};
        for (int i = 0; i < n * n; ++i) both_[i] = 1.0;
        int bit = 0;
        while ((m >> (bit + 1)) > 0) ++bit;
        while (bit-- > 0) {
            double_count();
            if (((m >> bit) & 1) != 0) add_sample();
        }
    }

    // Returns g(m) = 1 + a + … + a^(m-1), where a is the eigenvalue of mode i.
    const Complex& geometric(int i) const { return of_[i].geometric; }
    // Returns the sum over k = 1 … m of g_i(k) conj g_j(k), where g_i(k) = 1 + a + … + a^(k-1) with the
    // eigenvalue a of mode i.
    const Complex& both(int i, int j) const { return both_[i * modes_.n + j]; }

  private:
    // Sums over m samples for a mode with the eigenvalue a. Let g(k) be 1 + a + … + a^(k-1). `power`: a^m.
    // `geometric`: g(m). `sums`: g(1) + g(2) + … + g(m).
    struct OfMode {
        Complex power, geometric, sums;
    };

    void double_count() {
        const int n = modes_.n;
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                const Complex gi = of_[i].geometric, gj = std::conj(of_[j].geometric), pi = of_[i].power,
                              pj = std::conj(of_[j].power);
                Complex& sum = both_[i * n + j];
                sum += count_ * gi * gj + gi * pj * std::conj(of_[j].sums) + pi * gj * of_[i].sums +
                       pi * pj * sum;
            }
        }
        for (int i = 0; i < n; ++i) {
            OfMode& one = of_[i];
            one.sums += count_ * one.geometric + one.power * one.sums;
            one.geometric += one.power * one.geometric;
            one.power *= one.power;
        }
        count_ *= 2;
    }

    void add_sample() {
        const int n = modes_.n;
        for (int i = 0; i < n; ++i) {
            of_[i].geometric = of_[i].geometric + of_[i].power;
            of_[i].power *= modes_.a[i];
            of_[i].sums += of_[i].geometric;
        }
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                both_[i * n + j] += of_[i].geometric * std::conj(of_[j].geometric);
            }
        }
        count_ += 1;
    }

    const Modes<N>& modes_;
    double count_ = 1;  // number of samples for which the sums are computed so far
    OfMode of_[N];
    Complex both_[N * N];
};

// Returns a forecast of the mean, over the next m samples, of the scalar product of `weights` and the state
// x. If m = 0, the result is the present scalar product.
//
// The state j samples ahead is A^j times the present state, plus noise. For an eigenvector of A (Modes), A^j
// is the power a^j of its eigenvalue a. Let g(m) be 1 + a + … + a^(m-1) (ModeSums). Then the mean of a^j over
// j = 1 … m is a g(m) / m. Noise that is added j samples ahead remains in the samples j to m. Its weight in
// the mean is therefore g(m - j + 1) / m.
template <int N>
MeanAhead<N> mean_ahead(const System<N>& s, const double* weights, long long m) {
    typedef std::complex<double> Complex;
    MeanAhead<N> found;
    found.variance = 0;
    for (int i = 0; i < N; ++i) found.row[i] = i < s.n ? weights[i] : 0;
    if (m <= 0) return found;
    const int n = s.n;
    const Modes<N> modes(s, weights);
    const ModeSums<N> sums(modes, m);
    const Complex* const weight = modes.weight;
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            found.variance +=
                (weight[i] * std::conj(weight[j]) * modes.noise[i * n + j] * sums.both(i, j)).real();
        }
    }
    found.variance = found.variance > 0 ? found.variance / (double(m) * double(m)) : 0;
    for (int i = 0; i < n; ++i) {
        const Complex mean = weight[i] * modes.a[i] * sums.geometric(i) / double(m);
        if (i >= 2 * s.pairs) {
            found.row[i] = mean.real();
        } else if (i % 2 == 0) {  // the mode ξ = x + i y and its conjugate add 2 Re(mean · ξ)
            found.row[i] = 2 * mean.real();
            found.row[i + 1] = -2 * mean.imag();
        }
    }
    return found;
}

// Returns the spectral density, at frequency 0, of what the states for which `in` is true add to a sample. If
// these states are fast, their part in the mean of many samples has the variance: density divided by the
// number of samples.
template <int N>
double density_at_zero(const System<N>& s, const bool* in) {
    double M[N * N], row[N];
    for (int i = 0; i < s.n; ++i) {
        row[i] = in[i] ? s.c[i] : 0;
        for (int j = 0; j < s.n; ++j) M[i * s.n + j] = i == j ? (in[i] ? 1 - s.a[i] : 1) : 0;
    }
    for (int i = 0; i < 2 * s.pairs; i += 2) {  // M is the transpose of I - A
        M[(i + 1) * s.n + i] = -s.b[i];
        M[i * s.n + i + 1] = s.b[i];
    }
    return solve(M, row, s.n, 1) ? form(row, s.Q, row, s.n) : 0;
}

}  // namespace track
}  // namespace fltea
