// The sums for one instruction set (whittle_kernel.hpp). Compiled once per set, see CMakeLists.txt.
#include "whittle_kernel.hpp"

#include "pack_log.hpp"
#include "set_name.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {
namespace {

using engine::kWidth;
typedef engine::Pack<double, kWidth> Number;

Number load(const double* from) {
    Number number;
    std::memcpy(&number.v, from, sizeof number.v);
    return number;
}
void store(double* to, Number number) { std::memcpy(to, &number.v, sizeof number.v); }
double sum(Number number) {
    double total = 0;
    for (int i = 0; i < kWidth; ++i) total += number[i];
    return total;
}

// Each family: spectra of its parts for unit innovations, and the slopes of their logarithms by the shapes,
// of which shape k belongs to the part `part_of(k)`.
struct White {
    enum { kShapes = 0, kParts = 0 };
    static int part_of(int) { return 0; }
    explicit White(const Natural&) {}
    void at(const Bins&, std::size_t, Number*, Number*) const {}
    void parts(const Bins&, std::size_t, Number*) const {}
};

struct Fractional {
    enum { kShapes = 2, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Fractional(const Natural& natural) : alpha(natural.shape[0]), g(natural.shape[1]) {}

    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        const Number ln_size = load(bins.ln_size + i), quarter = load(bins.quarter + i);
        const Number size = engine::exp(alpha * ln_size);
        const Number turn = turns(bins, i, quarter);
        const Number real = size * engine::sin_pi(turn + 0.5), imaginary = size * engine::sin_pi(turn);
        part[0] = 1.0 / distance(size, real);
        const Number by_alpha = 2.0 * (size * size * ln_size - g * (ln_size * real - quarter * imaginary));
        slope[0] = -by_alpha * part[0];
        slope[1] = 2.0 * (real - g) * part[0];
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        const Number size = engine::exp(alpha * load(bins.ln_size + i));
        const Number turn = turns(bins, i, load(bins.quarter + i));
        part[0] = 1.0 / distance(size, size * engine::sin_pi(turn + 0.5));
    }

  private:
    // The angle of (1 - e^{-iλ})^α e^{iλ}, over π.
    Number turns(const Bins& bins, std::size_t i, Number quarter) const {
        return (alpha * quarter + load(bins.turn + i)) * 0.31830988618379067;
    }
    // |(1 - e^{-iλ})^α - g e^{-iλ}|². Positive but for rounding.
    Number distance(Number size, Number real) const {
        return max(size * size - 2.0 * g * real + g * g, Number(1e-200));
    }
    Number alpha, g;
};

Number ar1(Number phi, Number square) { return 1.0 / ((1.0 - phi) * (1.0 - phi) + phi * square); }

struct Ar2 {
    enum { kShapes = 2, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Ar2(const Natural& natural) : phi1(natural.shape[0]), phi2(natural.shape[1]) {}
    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        const Number cos1 = load(bins.cos1 + i), sin1 = load(bins.sin1 + i);
        const Number cos2 = load(bins.cos2 + i), sin2 = load(bins.sin2 + i);
        const Number real = 1.0 - phi1 * cos1 - phi2 * cos2, imaginary = phi1 * sin1 + phi2 * sin2;
        part[0] = 1.0 / max(real * real + imaginary * imaginary, Number(1e-200));
        slope[0] = 2.0 * (real * cos1 - imaginary * sin1) * part[0];
        slope[1] = 2.0 * (real * cos2 - imaginary * sin2) * part[0];
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        Number slope[kShapes];
        at(bins, i, part, slope);
    }

  private:
    Number phi1, phi2;
};

// K relaxations.
template <int K>
struct Sum {
    enum { kShapes = K, kParts = K };
    static int part_of(int k) { return k; }
    explicit Sum(const Natural& natural) {
        for (int k = 0; k < K; ++k) phi[k] = Number(natural.shape[k]);
    }
    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        parts(bins, i, part);
        const Number square = load(bins.square + i);
        for (int k = 0; k < K; ++k) slope[k] = (2.0 * (1.0 - phi[k]) - square) * part[k];
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        const Number square = load(bins.square + i);
        for (int k = 0; k < K; ++k) part[k] = ar1(phi[k], square);
    }

  private:
    Number phi[K];
};

// White noise through a low-pass and then sampled, so that three branches of its spectrum lie over each
// other, and K relaxations.
template <int K>
struct LowPass {
    enum { kShapes = K + 2, kParts = K + 1 };
    static int part_of(int k) { return k < 2 ? 0 : k - 1; }
    explicit LowPass(const Natural& natural) : log_c(natural.shape[0]), n(natural.shape[1]) {
        for (int k = 0; k < K; ++k) phi[k] = Number(natural.shape[k + 2]);
    }
    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        const Number lam = load(bins.turn + i), square = load(bins.square + i);
        part[0] = slope[0] = slope[1] = Number(0.0);
        const Number branches[] = {lam, 2 * kPi - lam, 2 * kPi + lam};
        for (const Number& branch : branches) {
            const Number log_ratio = 2.0 * engine::log(branch) - log_c, one = gain(log_ratio);
            part[0] += one;
            slope[0] += one * (1.0 - one);
            slope[1] += one * (1.0 - one) * log_ratio;
        }
        slope[0] = n * slope[0] / part[0];
        slope[1] = -slope[1] / part[0];
        for (int k = 0; k < K; ++k) {
            part[k + 1] = ar1(phi[k], square);
            slope[k + 2] = (2.0 * (1.0 - phi[k]) - square) * part[k + 1];
        }
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        Number slope[kShapes];
        at(bins, i, part, slope);
    }

  private:
    // Far above the corner it is as good as nothing, and the power would leave the range of doubles.
    Number gain(Number log_ratio) const {
        return 1.0 / (1.0 + engine::exp(-max(-n * log_ratio, Number(-200.0))));
    }
    static constexpr double kPi = 3.141592653589793;
    Number log_c, n, phi[K + 1];
};

struct Arfima {
    enum { kShapes = 2, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Arfima(const Natural& natural) : d(natural.shape[0]), phi(natural.shape[1]) {}
    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        const Number ln_size = load(bins.ln_size + i), square = load(bins.square + i);
        const Number relaxation = ar1(phi, square);
        part[0] = engine::exp(-2.0 * d * ln_size) * relaxation;
        slope[0] = -2.0 * ln_size;
        slope[1] = (2.0 * (1.0 - phi) - square) * relaxation;
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        Number slope[kShapes];
        at(bins, i, part, slope);
    }

  private:
    Number d, phi;
};

struct Rising {
    enum { kShapes = 1, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Rising(const Natural& natural) : delta(natural.shape[0]) {}
    void at(const Bins& bins, std::size_t i, Number* part, Number* slope) const {
        parts(bins, i, part);
        slope[0] = 2.0 * load(bins.ln_size + i);
    }
    void parts(const Bins& bins, std::size_t i, Number* part) const {
        part[0] = engine::exp(2.0 * delta * load(bins.ln_size + i));
    }

  private:
    Number delta;
};

template <class Shape>
void sums_of(const Bins& bins, const double* power, const Natural& natural, Sums& out) {
    enum { kNumbers = Shape::kShapes + Shape::kParts + 1, kSquares = kNumbers * (kNumbers + 1) / 2 };
    const Shape shape(natural);
    const Number white(natural.white);
    Number log_spectrum(0.0), ratio(0.0), slopes[kNumbers], weighted[kNumbers], squares[kSquares];
    for (int k = 0; k < kNumbers; ++k) slopes[k] = weighted[k] = Number(0.0);
    for (int k = 0; k < kSquares; ++k) squares[k] = Number(0.0);
    for (std::size_t i = 0; i < bins.size; i += kWidth) {
        Number part[Shape::kParts + 1], by[Shape::kShapes + 1], D[kNumbers];
        shape.at(bins, i, part, by);
        Number spectrum = white;
        for (int k = 0; k < Shape::kParts; ++k) {
            part[k] = part[k] * Number(natural.variance[k]);
            spectrum += part[k];
        }
        const Number inverse = 1.0 / spectrum, count = load(bins.counts + i);
        const Number over = count * load(power + i) * inverse;
        log_spectrum += count * engine::log(spectrum);
        ratio += over;
        for (int k = 0; k < Shape::kParts; ++k) D[Shape::kShapes + k] = part[k] * inverse;
        for (int k = 0; k < Shape::kShapes; ++k) D[k] = by[k] * D[Shape::kShapes + Shape::part_of(k)];
        D[kNumbers - 1] = white * inverse;
        int square = 0;
        for (int k = 0; k < kNumbers; ++k) {
            const Number counted = count * D[k];
            slopes[k] += counted;
            weighted[k] += over * D[k];
            for (int j = 0; j <= k; ++j, ++square) squares[square] += counted * D[j];
        }
    }
    out.log_spectrum = sum(log_spectrum);
    out.ratio = sum(ratio);
    int square = 0;
    for (int k = 0; k < kNumbers; ++k) {
        out.slope[k] = sum(slopes[k]);
        out.weighted[k] = sum(weighted[k]);
        for (int j = 0; j <= k; ++j, ++square) out.square[k][j] = sum(squares[square]);
    }
}

template <class Shape>
double ratios_of(const Bins& bins, const double* power, std::size_t series, const Natural& natural, bool same,
                 double* parts, double* ratio) {
    const Shape shape(natural);
    if (!same) {
        for (std::size_t i = 0; i < bins.size; i += kWidth) {
            Number part[Shape::kParts + 1];
            shape.parts(bins, i, part);
            for (int k = 0; k < Shape::kParts; ++k) store(parts + k * bins.size + i, part[k]);
        }
    }
    Number log_spectrum(0.0);
    for (std::size_t s = 0; s < series; ++s) ratio[s] = 0;
    // A stretch of bins for all series: the spectra of it stay in registers and in the nearest cache.
    enum { kStretch = 64 };
    Number over[kStretch / kWidth];
    for (std::size_t begin = 0; begin < bins.size; begin += kStretch) {
        const std::size_t end = begin + kStretch < bins.size ? begin + kStretch : bins.size;
        for (std::size_t i = begin; i < end; i += kWidth) {
            Number spectrum(natural.white);
            for (int k = 0; k < Shape::kParts; ++k)
                spectrum += Number(natural.variance[k]) * load(parts + k * bins.size + i);
            const Number count = load(bins.counts + i);
            log_spectrum += count * engine::log(spectrum);
            over[(i - begin) / kWidth] = count / spectrum;
        }
        for (std::size_t s = 0; s < series; ++s) {
            const double* const row = power + s * bins.size;
            Number total(0.0);
            for (std::size_t i = begin; i < end; i += kWidth)
                total += over[(i - begin) / kWidth] * load(row + i);
            ratio[s] += sum(total);
        }
    }
    return sum(log_spectrum);
}

struct Functions {
    void (*sums)(const Bins&, const double*, const Natural&, Sums&);
    double (*ratios)(const Bins&, const double*, std::size_t, const Natural&, bool, double*, double*);
};

template <class Shape>
constexpr Functions functions() {
    return Functions{sums_of<Shape>, ratios_of<Shape>};
}

const Functions kTable[kFamilies] = {
    functions<White>(),  functions<Fractional>(), functions<Sum<1>>(),     functions<Ar2>(),
    functions<Sum<2>>(), functions<Sum<3>>(),     functions<Sum<4>>(),     functions<Sum<5>>(),
    functions<Sum<6>>(), functions<LowPass<0>>(), functions<LowPass<1>>(), functions<LowPass<2>>(),
    functions<Arfima>(), functions<Rising>(),
};

void sums(Family family, const Bins& bins, const double* power, const Natural& at, Sums& out) {
    kTable[family].sums(bins, power, at, out);
}

double ratios(Family family, const Bins& bins, const double* power, std::size_t series, const Natural& at,
              bool same, double* parts, double* ratio) {
    return kTable[family].ratios(bins, power, series, at, same, parts, ratio);
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

extern const Kernel FLTEA_JOIN(kernel_, FLTEA_INSTRUCTION_SET) = {FLTEA_STRING(FLTEA_INSTRUCTION_SET), sums,
                                                                  ratios};

}  // namespace whittle
}  // namespace fltea
