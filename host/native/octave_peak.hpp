// Searches an octave spectrum (host/fltea/spectrum/ordinates.py) for the most significant peak. The spectrum
// consists of lines. A line is the mean power of one or more ordinates; an ordinate is the power at a single
// frequency of a periodogram. A peak is a range of neighbouring lines whose mean power exceeds that of its
// flanks, the lines on either side, by more than chance explains.
//
// Most lines are averages over blocks of samples under Hann's window. The powers of neighbouring averaged
// lines are correlated, so each further line of a range adds less information than the first one. A short
// range therefore has more degrees of freedom per line than a long one.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace fltea {
namespace peak {

struct Found {
    bool any;
    std::size_t start, stop;
    double level;  // noise level around the peak
};

// Constants of the search. Those that the search in whole recordings has, too, are explained there
// (host/fltea/spectrum/ordinate_peak.py).
constexpr double kFlank = 48;  // least number of ordinates in a flank
constexpr double kWidestShare = 0.08;
// least number of lines in a flank, even where fewer lines stand for kFlank ordinates
constexpr std::size_t kShortestFlank = 12;
// least number of lines in a flank that the spectrum's edge cuts short
constexpr std::size_t kLeastFlank = 4;
constexpr double kLeastInFlank = 16;  // least number of ordinates in such a flank
constexpr std::size_t kEndFlank = 4;  // least number of lines in the lower flank near frequency 0
// Widths of ranges near the ends of the spectrum [lines]. There, the search is only for peaks as narrow as a
// spectral line of a single frequency.
constexpr std::size_t kEndWidths[] = {1, 2};
// At an end of the spectrum, a range may have only one flank. It is divided into two parts with the means
// `near` (next to the range) and `far`. The noise level at the range is extrapolated as near²/far. If both
// parts have equally many ordinates, the relative variance of this level is kContinued times that of `near`:
// 4 times from near², and once from `far`.
constexpr double kContinued = 5;
// largest number of lines in a range that contains averaged lines; 8 such lines are a fifth of an octave
constexpr std::size_t kWidest = 8;
// If the noise level were known, a peak would be significant if it raised the log likelihood by a certain
// gain, which hopeless() computes. A range of lines is tested only if its gain is at least this fraction of
// that gain.
constexpr double kHopeless = 0.6;
// least noise level that is assumed, as a fraction of the mean of the spectrum
constexpr double kLeastLevel = 1e-12;

// Returns Peizer and Pratt's function (1 - x² + 2x log x) / (1 - x)². Near x = 1, it is (1 - x)/3.
inline double peizer_pratt(double x) {
    const double away = 1 - x;
    return std::fabs(away) < 1e-3 ? away / 3 : (1 - x * x + 2 * x * std::log(x)) / (away * away);
}

// Returns the standard normal deviate that is exceeded with the same probability as the value `ratio` of an F
// distribution with `a` and `b` degrees of freedom. This is Peizer and Pratt's approximation (J. Am. Stat.
// Assoc. 63, 1968), as in f_deviate of host/fltea/noise/distributions.py.
inline double f_deviate(double ratio, double a, double b) {
    const double s = (b - 1) / 2, t = (a - 1) / 2, n = s + t;
    const double p = std::fmin(std::fmax(b / (a * ratio + b), 1e-300), 1 - 1e-12), q = 1 - p;
    const double d = s + 1.0 / 6 - (n + 1.0 / 3) * p + 0.04 * (q / b - p / a + (q - 0.5) / (a + b));
    const double spread =
        (1 + q * peizer_pratt(s / (n * p)) + p * peizer_pratt(t / (n * q))) / ((n + 1.0 / 6) * p * q);
    return d * std::sqrt(spread);
}

// Returns the standard normal deviate z that is exceeded with the probability `probability`, which is below
// 0.5. Newton's method solves for the logarithm of the probability, which is a concave function of z. The
// iteration begins above the solution, so each step comes closer to the solution from above.
inline double critical(double probability) {
    double z = std::sqrt(-2 * std::log(2 * probability));
    for (int step = 0; step < 50; ++step) {
        const double above = std::erfc(z * std::sqrt(0.5)) / 2;
        const double density = std::exp(-z * z / 2) / std::sqrt(2 * 3.14159265358979323846);
        const double move = std::log(above / probability) * above / density;
        z += move;
        if (std::fabs(move) < 1e-13 * (1 + z)) break;
    }
    return z;
}

class Search {
  public:
    // `power`, `weight`: arrays with an entry for each of the `size` lines of the spectrum. `weight` is the
    // number of ordinates (single frequencies of a periodogram) that a line stands for.
    Search(const double* power, const double* weight, std::size_t size)
        : size_(size), sums_(size + 1), weights_(size + 1), averaged_(size + 1) {
        for (std::size_t i = 0; i < size; ++i) {
            sums_[i + 1] = sums_[i] + weight[i] * power[i];
            weights_[i + 1] = weights_[i] + weight[i];
            averaged_[i + 1] = averaged_[i] + (weight[i] != std::rint(weight[i]));
        }
        least_ = size ? kLeastLevel * sums_[size] / weights_[size] : 0;
    }

    Found strongest(double false_alarm) const {
        Best best;
        at_the_ends(false_alarm / 2, best);
        between(false_alarm / 2, best);
        return best.found;
    }

  private:
    struct Best {
        Found found{false, 0, 0, 0};
        double gain = 0;
    };
    struct Range {
        std::size_t from, to;
    };
    struct Try {
        Range own, low, high;
    };

    double weight(Range r) const { return weights_[r.to] - weights_[r.from]; }
    double mean(Range r) const { return (sums_[r.to] - sums_[r.from]) / std::fmax(weight(r), 1e-300); }
    bool is_averaged(std::size_t i) const { return averaged_[i + 1] != averaged_[i]; }

    // Returns the effective number of independent ordinates in `width` neighbouring averaged lines, as a
    // multiple of the sum of the lines' weights. The factor is near 1 for many lines, and nearly 2 for a
    // single line.
    static double gathered(std::size_t width) {
        // correlations between the powers of lines under Hann's window
        const double of_next = 4.0 / 9, of_second = 1.0 / 36;
        const double w = static_cast<double>(width);
        const double correlated =
            1 + 2 * (of_next * std::fmax(1 - 1 / w, 0) + of_second * std::fmax(1 - 2 / w, 0));
        return (1 + 2 * (of_next + of_second)) / correlated;
    }
    double effective(Range own) const {
        return weight(own) * (is_averaged(own.from) ? gathered(own.to - own.from) : 1);
    }
    static double gain_of(double effective, double ratio) {
        return effective * (ratio - 1 - std::log(ratio));
    }
    // Returns the gain in log likelihood below which a range of lines is not tested. The test is whether the
    // range exceeds the noise level by `deviate` standard deviations. If the noise level were known, this
    // would need a gain of about deviate²/2. Most ranges are far below that, and need no exact test.
    static double hopeless(double deviate) { return kHopeless * deviate * deviate / 2; }

    // Returns the index at which a range of lines has to begin if it ends before `end`. The range must have
    // at least `lines` lines, and together these must stand for at least `ordinates` ordinates.
    std::size_t down(std::size_t end, double ordinates, std::size_t lines) const {
        const auto next = std::upper_bound(weights_.begin(), weights_.end(), weights_[end] - ordinates);
        const std::ptrdiff_t enough = next - weights_.begin() - 1;
        const std::ptrdiff_t many = static_cast<std::ptrdiff_t>(end) - static_cast<std::ptrdiff_t>(lines);
        return static_cast<std::size_t>(std::max<std::ptrdiff_t>(std::min(enough, many), 0));
    }
    std::size_t up(std::size_t begin, double ordinates, std::size_t lines) const {
        const auto next = std::lower_bound(weights_.begin(), weights_.end(), weights_[begin] + ordinates);
        const std::size_t enough = static_cast<std::size_t>(next - weights_.begin());
        return std::min(std::max(enough, begin + lines), size_);
    }

    std::vector<Try> tries() const {
        // A flank needs at least kFlank ordinates. to[i]: where the shortest such flank ends that begins at
        // line i. from[i]: where the shortest such flank begins that ends before line i.
        std::vector<std::size_t> to(size_ + 1), from(size_ + 1);
        for (std::size_t i = 0, high = 0, low = 0; i <= size_; ++i) {
            while (high <= size_ && weights_[high] < weights_[i] + kFlank) ++high;
            while (low < i && weights_[low + 1] <= weights_[i] - kFlank) ++low;
            to[i] = high;
            from[i] = low;
        }
        std::vector<Try> found;
        const double widest = std::fmax(kWidestShare * static_cast<double>(size_), 1);
        for (std::size_t width = 1; static_cast<double>(width) <= widest; width *= 2) {
            const std::size_t flank = std::max(kShortestFlank, 2 * width),
                              least = std::max(kLeastFlank, width);
            const std::size_t step = std::max<std::size_t>(1, width / 4);
            for (std::size_t at = 0; at + 2 * width <= size_; at += step) {
                if (at < width || (width > kWidest && averaged_[at + width] != averaged_[at])) continue;
                const std::size_t after = at + 2 * width, before = at - width;
                const Range low{std::min(from[before], before > flank ? before - flank : 0), before};
                const Range high{after, std::min(std::max(to[after], after + flank), size_)};
                if (std::min(high.to - high.from, low.to - low.from) < least) continue;
                if (weight(high) < kLeastInFlank || weight(low) < kLeastInFlank) continue;
                found.push_back(Try{{at, at + width}, low, high});
            }
        }
        return found;
    }

    void between(double false_alarm, Best& best) const {
        const std::vector<Try> all = tries();
        if (all.empty()) return;
        const double deviate = critical(false_alarm / static_cast<double>(all.size()));
        const double hope = std::fmax(hopeless(deviate), best.gain);
        // Among the ranges that pass the test, the one with the largest gain in log likelihood is chosen. The
        // largest deviate would be the wrong choice: wide ranges have longer flanks, so that a peak of the
        // same height has a larger deviate there.
        for (const Try& one : all) {
            const double low = mean(one.low), high = mean(one.high), level = std::fmax(low, high);
            const double ratio = mean(one.own) / std::fmax(level, least_);
            if (!(ratio > 1)) continue;
            const double gain = gain_of(effective(one.own), ratio);
            if (!(gain > hope && gain > best.gain)) continue;
            const double other = weight(low > high ? one.low : one.high);
            if (!(f_deviate(ratio, 2 * effective(one.own), 2 * other) > deviate)) continue;
            best.gain = gain;
            best.found = Found{true, one.own.from, one.own.to, level};
        }
    }

    // A range of lines that is too close to an end of the spectrum for two complete flanks. If `two_sided` is
    // true, the range is compared with a flank on each side: `near` below and `other` above it. Otherwise it
    // is compared with two parts of the lower flank: `near` is next to it, and `other` is below `near`.
    struct AtAnEnd {
        Range own, near, other;
        bool two_sided;
    };

    std::vector<AtAnEnd> tries_at_the_ends() const {
        std::vector<AtAnEnd> found;
        const auto index = [](std::size_t one) { return static_cast<std::ptrdiff_t>(one); };
        for (const std::size_t width : kEndWidths) {
            const auto begin = weights_.begin(), end = weights_.end();
            const std::ptrdiff_t first = std::lower_bound(begin, end, kLeastInFlank) - begin + index(width);
            const std::ptrdiff_t filled =
                std::upper_bound(begin, end, weights_[size_] - kLeastInFlank) - begin - 1;
            const std::ptrdiff_t last =
                std::min(filled, index(size_) - index(kLeastFlank)) - 2 * index(width);
            for (std::ptrdiff_t at = index(kEndFlank + width); at < std::min(first, last + 1); ++at)
                found.push_back(at_an_end(static_cast<std::size_t>(at), width));
            // In steep noise, the power can rise so much from one averaged line to the next that the rise
            // looks like a peak. A range of two averaged lines is therefore not tried here.
            if (width > 1 && is_averaged(size_ - 1)) continue;
            for (std::ptrdiff_t at = std::max(last + 1, first); at <= index(size_) - index(width); ++at)
                found.push_back(at_an_end(static_cast<std::size_t>(at), width));
        }
        return found;
    }

    AtAnEnd at_an_end(std::size_t at, std::size_t width) const {
        const std::size_t after = std::min(at + 2 * width, size_), before = at - width;
        const Range high{after, up(after, kFlank, kLeastFlank)};
        if (high.to - high.from >= kLeastFlank && weight(high) >= kLeastInFlank)
            return {{at, at + width}, {down(before, kFlank, kShortestFlank), before}, high, true};
        const std::size_t begin = down(before, kFlank / 2, kLeastFlank);
        return {{at, at + width}, {begin, before}, {down(begin, kFlank / 2, kLeastFlank), begin}, false};
    }

    void at_the_ends(double false_alarm, Best& best) const {
        if (size_ == 0) return;
        const std::vector<AtAnEnd> all = tries_at_the_ends();
        if (all.empty()) return;
        const double deviate = critical(false_alarm / static_cast<double>(all.size()));
        for (const AtAnEnd& one : all) {
            const double near = std::fmax(mean(one.near), least_), other = mean(one.other);
            const double far = std::fmax(other, least_);
            const double level = one.two_sided ? std::fmax(near, far)
                                 : other > 0   ? near * std::fmax(near / other, 1)
                                               : near;
            const double own = effective(one.own), ratio = mean(one.own) / level;
            if (!(ratio > 1)) continue;
            const double gain = gain_of(own, ratio);
            if (!(gain > std::fmax(hopeless(deviate), best.gain))) continue;
            // The range has to pass the test with each of the two flanks alone, because a short flank is
            // often low by chance.
            const auto passes = [&](double around, double ordinates) {
                return f_deviate(mean(one.own) / around, 2 * own, 2 * ordinates) > deviate;
            };
            const bool continues = !one.two_sided && is_averaged(one.own.from);
            const bool sure = one.two_sided ? passes(near, weight(one.near)) && passes(far, weight(one.other))
                                            : passes(level, weight(one.near) / (continues ? kContinued : 1));
            if (!sure) continue;
            best.gain = gain;
            best.found = Found{true, one.own.from, one.own.to, level};
        }
    }

    std::size_t size_;
    std::vector<double> sums_, weights_;
    std::vector<int> averaged_;
    double least_ = 0;
};

}  // namespace peak
}  // namespace fltea
