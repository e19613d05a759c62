// The models' noise spectra, which are fitted to a periodogram. One source serves the host's kernels (several
// bins at a time, in double) and the board (bin by bin, in float). This file also has the sums over the bins
// for the host's fits. The sums for the board's fits are in sliced_target.hpp.
//
// The argument `bins` gives numbers of bin i (or of kWidth bins from i on) that do not depend on the model's
// parameters. λ is the bin's frequency [radians per sample], and i in an exponent is the imaginary unit:
//   counts(i): how many values of the periodogram the bin averages
//   ln_size(i): log |1 - e^{-iλ}|
//   quarter(i): (π - λ) / 2
//   turn(i): λ
//   square(i): |1 - e^{-iλ}|²
//   cos1(i), sin1(i), cos2(i), sin2(i): cosine and sine of λ and of 2λ
#ifndef FLTEA_WHITTLE_SHAPES_HPP
#define FLTEA_WHITTLE_SHAPES_HPP

#include <cstddef>

#include "pack_math.hpp"
#include "real_math.hpp"
#include "whittle_numbers.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// Returns the least value to which the inverse of a part's spectrum is set. Rounding can make the inverse
// smaller, even 0, and the spectrum would then be infinite.
template <class R>
constexpr R nearly_nothing() {
    return sizeof(R) == 8 ? R(1e-200) : R(1e-30);
}

template <class Number>
Number exp_of(Number x) {
    return engine::exp(x);
}
inline float exp_of(float x) { return math::exp(x); }
// sin(pi x) for 0 <= x <= 3/2.
template <class Number>
Number sin_pi_of(Number x) {
    return engine::sin_pi(x);
}
inline float sin_pi_of(float x) { return math::sin_pi(x); }

// Each class below is one family of spectra. It computes the spectrum that each part has if the white noise
// that drives the part has variance 1. It also computes the derivatives of the logarithms of these spectra by
// the shapes, the numbers that determine the form of a part, such as α. Shape k belongs to the part
// `part_of(k)`.
template <class Number>
struct White {
    enum { kShapes = 0, kParts = 0 };
    static int part_of(int) { return 0; }
    template <class R>
    explicit White(const Natural<R>&) {}
    template <class Columns>
    void at(const Columns&, std::size_t, Number*, Number*) const {}
    template <class Columns>
    void parts(const Columns&, std::size_t, Number*) const {}
};

template <class Number>
struct Fractional {
    typedef engine::Real<Number> R;
    enum { kShapes = 2, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Fractional(const Natural<R>& natural) : alpha(natural.shape[0]), g(natural.shape[1]) {}

    template <class Columns>
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        const Number ln_size = bins.ln_size(i), quarter = bins.quarter(i);
        const Number size = exp_of(alpha * ln_size);
        const Number turn = turns(bins, i, quarter);
        const Number real = size * sin_pi_of(turn + R(0.5)), imaginary = size * sin_pi_of(turn);
        part[0] = R(1.0) / distance(size, real);
        const Number by_alpha = R(2.0) * (size * size * ln_size - g * (ln_size * real - quarter * imaginary));
        slope[0] = -by_alpha * part[0];
        slope[1] = R(2.0) * (real - g) * part[0];
    }
    template <class Columns>
    void parts(const Columns& bins, std::size_t i, Number* part) const {
        const Number size = exp_of(alpha * bins.ln_size(i));
        const Number turn = turns(bins, i, bins.quarter(i));
        part[0] = R(1.0) / distance(size, size * sin_pi_of(turn + R(0.5)));
    }

  private:
    // The argument (angle) of (1 - e^{-iλ})^α e^{iλ}, divided by π, for the order α at the frequency λ.
    template <class Columns>
    Number turns(const Columns& bins, std::size_t i, Number quarter) const {
        return (alpha * quarter + bins.turn(i)) * R(0.31830988618379067);
    }
    // |(1 - e^{-iλ})^α - g e^{-iλ}|², the inverse of the spectrum of the fractional model with order α and
    // feedback g. Only rounding can make the inverse zero or negative.
    Number distance(Number size, Number real) const {
        using engine::max;
        return max(size * size - R(2.0) * g * real + g * g, Number(nearly_nothing<R>()));
    }
    Number alpha, g;
};

template <class Number>
Number relaxation_of(Number phi, Number square) {
    typedef engine::Real<Number> R;
    return R(1.0) / ((R(1.0) - phi) * (R(1.0) - phi) + phi * square);
}

template <class Number>
struct Ar2 {
    typedef engine::Real<Number> R;
    enum { kShapes = 2, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Ar2(const Natural<R>& natural) : phi1(natural.shape[0]), phi2(natural.shape[1]) {}
    template <class Columns>
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        const Number cos1 = bins.cos1(i), sin1 = bins.sin1(i);
        const Number cos2 = bins.cos2(i), sin2 = bins.sin2(i);
        using engine::max;
        const Number real = R(1.0) - phi1 * cos1 - phi2 * cos2, imaginary = phi1 * sin1 + phi2 * sin2;
        part[0] = R(1.0) / max(real * real + imaginary * imaginary, Number(nearly_nothing<R>()));
        slope[0] = R(2.0) * (real * cos1 - imaginary * sin1) * part[0];
        slope[1] = R(2.0) * (real * cos2 - imaginary * sin2) * part[0];
    }
    template <class Columns>
    void parts(const Columns& bins, std::size_t i, Number* part) const {
        Number slope[kShapes];
        at(bins, i, part, slope);
    }

  private:
    Number phi1, phi2;
};

// A sum of K independent AR(1) (first-order autoregressive processes).
template <class Number, int K>
struct Relaxations {
    typedef engine::Real<Number> R;
    enum { kShapes = K, kParts = K };
    static int part_of(int k) { return k; }
    explicit Relaxations(const Natural<R>& natural) {
        for (int k = 0; k < K; ++k) phi[k] = Number(natural.shape[k]);
    }
    template <class Columns>
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        parts(bins, i, part);
        const Number square = bins.square(i);
        for (int k = 0; k < K; ++k) slope[k] = (R(2.0) * (R(1.0) - phi[k]) - square) * part[k];
    }
    template <class Columns>
    void parts(const Columns& bins, std::size_t i, Number* part) const {
        const Number square = bins.square(i);
        for (int k = 0; k < K; ++k) part[k] = relaxation_of(phi[k], square);
    }

  private:
    Number phi[K];
};

// Accumulates the sums over the bins that a Whittle fit needs (Sums in whittle_numbers.hpp).
template <class Number, int kNumbers>
struct RunningSums {
    enum { kSquares = kNumbers * (kNumbers + 1) / 2 };

    RunningSums() : log_spectrum(0), ratio(0) {
        for (int k = 0; k < kNumbers; ++k) slopes[k] = weighted[k] = Number(0);
        for (int k = 0; k < kSquares; ++k) squares[k] = Number(0);
    }

    // `sum`: a function that adds all numbers of a pack (pack.hpp) together.
    template <class Out, class SumOf>
    void read(Out& out, SumOf sum) const {
        out.log_spectrum = sum(log_spectrum);
        out.ratio = sum(ratio);
        int square = 0;
        for (int k = 0; k < kNumbers; ++k) {
            out.slope[k] = sum(slopes[k]);
            out.weighted[k] = sum(weighted[k]);
            for (int j = 0; j <= k; ++j, ++square) out.square[k][j] = sum(squares[square]);
        }
    }

    Number log_spectrum, ratio, slopes[kNumbers], weighted[kNumbers], squares[kSquares];
};

// Adds bin i with the power I (`power`) to the sums that a fit needs. For Whittle's likelihood, the first of
// the sums is that of c log S: c is the bin's number of ordinates, and S the model's spectrum. For other
// likelihoods it is another sum, so its terms come from Likelihood::term(c, S, I, 1/S).
template <class Likelihood, class Shape, class Columns, class Number, class R>
inline void add_bin(const Shape& shape, const Columns& bins, std::size_t i, Number power,
                    const Natural<R>& natural,
                    RunningSums<Number, Shape::kShapes + Shape::kParts + 1>& sums) {
    enum { kNumbers = Shape::kShapes + Shape::kParts + 1 };
    const Number white(natural.white);
    Number part[Shape::kParts + 1], by[Shape::kShapes + 1], D[kNumbers];
    shape.at(bins, i, part, by);
    Number spectrum = white;
    for (int k = 0; k < Shape::kParts; ++k) {
        part[k] = part[k] * Number(natural.variance[k]);
        spectrum += part[k];
    }
    const Number inverse = R(1.0) / spectrum, count = bins.counts(i);
    const Number over = count * power * inverse;
    sums.log_spectrum += Likelihood::term(count, spectrum, power, inverse);
    sums.ratio += over;
    for (int k = 0; k < Shape::kParts; ++k) D[Shape::kShapes + k] = part[k] * inverse;
    for (int k = 0; k < Shape::kShapes; ++k) D[k] = by[k] * D[Shape::kShapes + Shape::part_of(k)];
    D[kNumbers - 1] = white * inverse;
    int square = 0;
    for (int k = 0; k < kNumbers; ++k) {
        const Number counted = count * D[k];
        sums.slopes[k] += counted;
        sums.weighted[k] += over * D[k];
        for (int j = 0; j <= k; ++j, ++square) sums.squares[square] += counted * D[j];
    }
}

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
