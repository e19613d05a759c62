// The sums for one instruction set (whittle_kernel.hpp). Compiled once per set, see CMakeLists.txt.
#include "whittle_kernel.hpp"

#include "pack_log.hpp"
#include "set_name.hpp"
#include "whittle_shapes.hpp"

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

// The columns of the bins, kWidth at a time.
struct Columns {
    const Bins& bins;
    std::size_t size() const { return bins.size; }
    Number counts(std::size_t i) const { return load(bins.counts + i); }
    Number ln_size(std::size_t i) const { return load(bins.ln_size + i); }
    Number quarter(std::size_t i) const { return load(bins.quarter + i); }
    Number turn(std::size_t i) const { return load(bins.turn + i); }
    Number cos1(std::size_t i) const { return load(bins.cos1 + i); }
    Number sin1(std::size_t i) const { return load(bins.sin1 + i); }
    Number cos2(std::size_t i) const { return load(bins.cos2 + i); }
    Number sin2(std::size_t i) const { return load(bins.sin2 + i); }
    Number square(std::size_t i) const { return load(bins.square + i); }
};

typedef whittle::White<Number> White;
typedef whittle::Fractional<Number> Fractional;
typedef whittle::Ar2<Number> Ar2;
template <int K>
using Sum = whittle::Relaxations<Number, K>;

// White noise through a low-pass and then sampled, so that three branches of its spectrum lie over each
// other, and K relaxations.
template <int K>
struct LowPass {
    enum { kShapes = K + 2, kParts = K + 1 };
    static int part_of(int k) { return k < 2 ? 0 : k - 1; }
    explicit LowPass(const Natural<double>& natural) : log_c(natural.shape[0]), n(natural.shape[1]) {
        for (int k = 0; k < K; ++k) phi[k] = Number(natural.shape[k + 2]);
    }
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        const Number lam = bins.turn(i), square = bins.square(i);
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
            part[k + 1] = relaxation_of(phi[k], square);
            slope[k + 2] = (2.0 * (1.0 - phi[k]) - square) * part[k + 1];
        }
    }
    void parts(const Columns& bins, std::size_t i, Number* part) const {
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
    explicit Arfima(const Natural<double>& natural) : d(natural.shape[0]), phi(natural.shape[1]) {}
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        const Number ln_size = bins.ln_size(i), square = bins.square(i);
        const Number relaxation = relaxation_of(phi, square);
        part[0] = engine::exp(-2.0 * d * ln_size) * relaxation;
        slope[0] = -2.0 * ln_size;
        slope[1] = (2.0 * (1.0 - phi) - square) * relaxation;
    }
    void parts(const Columns& bins, std::size_t i, Number* part) const {
        Number slope[kShapes];
        at(bins, i, part, slope);
    }

  private:
    Number d, phi;
};

struct Rising {
    enum { kShapes = 1, kParts = 1 };
    static int part_of(int) { return 0; }
    explicit Rising(const Natural<double>& natural) : delta(natural.shape[0]) {}
    void at(const Columns& bins, std::size_t i, Number* part, Number* slope) const {
        parts(bins, i, part);
        slope[0] = 2.0 * bins.ln_size(i);
    }
    void parts(const Columns& bins, std::size_t i, Number* part) const {
        part[0] = engine::exp(2.0 * delta * bins.ln_size(i));
    }

  private:
    Number delta;
};

struct Logarithm {
    static Number term(Number count, Number spectrum, Number, Number) {
        return count * engine::log(spectrum);
    }
};

template <class Shape>
void sums_of(const Bins& bins, const double* power, const Natural<double>& natural, Sums<double>& out) {
    enum { kNumbers = Shape::kShapes + Shape::kParts + 1 };
    const Columns columns = {bins};
    RunningSums<Number, kNumbers> running;
    const Shape shape(natural);
    for (std::size_t i = 0; i < bins.size; i += kWidth)
        add_bin<Logarithm>(shape, columns, i, load(power + i), natural, running);
    running.read(out, sum);
}

template <class Shape>
double ratios_of(const Bins& bins, const double* power, std::size_t series, const Natural<double>& natural,
                 bool same, double* parts, double* ratio) {
    const Shape shape(natural);
    if (!same) {
        for (std::size_t i = 0; i < bins.size; i += kWidth) {
            Number part[Shape::kParts + 1];
            shape.parts(Columns{bins}, i, part);
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
    void (*sums)(const Bins&, const double*, const Natural<double>&, Sums<double>&);
    double (*ratios)(const Bins&, const double*, std::size_t, const Natural<double>&, bool, double*, double*);
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

void sums(Family family, const Bins& bins, const double* power, const Natural<double>& at,
          Sums<double>& out) {
    kTable[family].sums(bins, power, at, out);
}

double ratios(Family family, const Bins& bins, const double* power, std::size_t series,
              const Natural<double>& at, bool same, double* parts, double* ratio) {
    return kTable[family].ratios(bins, power, series, at, same, parts, ratio);
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

extern const Kernel FLTEA_JOIN(kernel_, FLTEA_INSTRUCTION_SET) = {FLTEA_STRING(FLTEA_INSTRUCTION_SET), sums,
                                                                  ratios};

}  // namespace whittle
}  // namespace fltea
