// Whittle's likelihood of a sentence (sentence_kernel.hpp): Fisher scoring with Levenberg's damping between
// bounds, and what a further part would gain (Rao's score). Any parameter may be held, for profiles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "sentence_bins.hpp"

namespace fltea {
namespace sentence {

typedef std::vector<Word> Words;

inline int free_of(const Words& words) {
    int count = 0;
    for (const Word& word : words) count += kFree[word.part];
    return count;
}

// Lowest and highest value of each parameter of a word.
inline void bounds_of(const Word& word, const Bins& bins, double slowest, double* low, double* high) {
    const double power = std::log(bins.mean), least = power - kSmallest, most = power + kLargest;
    const double slow = std::log(bins.lowest / slowest), top = std::log(kPi);
    const auto set = [&](int i, double from, double to) {
        low[i] = from;
        high[i] = to;
    };
    switch (word.part) {
        case kWhite:
        case kWalk:
        case kQuantised:
        case kFloor:
            set(0, least, most);
            break;
        case kRelaxation:
        case kAlternating:
            set(0, least, most);
            set(1, slow, top);
            break;
        case kOrder:
        case kOrderByF:
        case kOrderByf:
            set(0, bins.lowest_order, bins.highest_order);
            set(1, -kLogitEnd, kLogitEnd);
            if (word.part == kOrderByF) set(0, -2.0, kHighestOrder), set(1, -kLogitEnd, 2 * kLn2);
            if (word.part == kOrderByf) set(1, -kLogitEnd, 2 * kLn2 - 2 * std::fmin(bins.log_h, 0.0));
            set(2, least, most);
            break;
        case kArfima:
            set(0, bins.lowest_order, std::fmin(bins.highest_order, 1.0));
            set(1, slow, kNoPole);
            set(2, least, most);
            break;
        case kResonance:
            set(0, least, most);
            set(1, std::log(bins.lowest), top);
            set(2, -9.0, kWidestPeak);
            break;
        case kRise:
            set(0, least, most);
            set(1, 0.1, 2.0);
            break;
        case kLowPass:
            set(0, 2 * std::log(bins.lowest), 4.5);
            set(1, -kLogitEnd, kLogitEnd);
            break;
        case kSharp:
            set(0, -0.2495, 2.0);
            break;
        case kNotch:
            set(0, std::log(bins.lowest), top - 1e-3);
            set(1, -7.0, 1.0);
            break;
        default:
            break;
    }
}

// A sentence with its parameters: the spectrum there, and the slopes of its logarithm.
class Spectrum {
  public:
    explicit Spectrum(const Bins& bins)
        : bins_(&bins),
          size_(bins.size()),
          total_(size_),
          part_(size_),
          gain_(size_),
          floor_(size_),
          over_(size_) {}

    // -log L, or infinity where there is no such spectrum.
    double at(const Words& words, const double* eta) {
        const Columns columns = bins_->columns();
        std::fill(total_.begin(), total_.end(), 0.0);
        std::fill(gain_.begin(), gain_.end(), 1.0);
        std::fill(floor_.begin(), floor_.end(), 0.0);
        rows_.resize(static_cast<std::size_t>(free_of(words)) * size_);
        int next = 0;
        for (const Word& word : words) {
            double* slope[3] = {nullptr, nullptr, nullptr};
            for (int k = 0; k < kFree[word.part]; ++k) slope[k] = row(next + k);
            if (!bins_->kernel->word(columns, word, eta + next, part_.data(), slope))
                return std::numeric_limits<double>::infinity();
            if (filters(word.part)) {
                bins_->kernel->times(size_, gain_.data(), part_.data(), gain_.data());
            } else {
                std::vector<double>& into = word.part == kFloor ? floor_ : total_;
                for (std::size_t i = 0; i < size_; ++i) into[i] += part_[i];
            }
            next += kFree[word.part];
        }
        // Slopes of the logarithm of the whole.
        bins_->kernel->whole(size_, gain_.data(), total_.data(), floor_.data(), part_.data(), over_.data());
        next = 0;
        for (const Word& word : words) {
            const std::vector<double>& by = filters(word.part) ? floor_ : word.part == kFloor ? part_ : over_;
            for (int k = 0; k < kFree[word.part]; ++k)
                bins_->kernel->times(size_, row(next + k), by.data(), row(next + k));
            next += kFree[word.part];
        }
        return bins_->kernel->nll(columns, total_.data());
    }

    const std::vector<double>& total() const { return total_; }
    const std::vector<double>& gain() const { return gain_; }
    const double* slope(int i) const { return rows_.data() + static_cast<std::size_t>(i) * size_; }

    // The slopes of -log L and the expected curvature.
    void derivatives(int free, double* gradient, double (*information)[kMostFree]) {
        const double* rows[kMostFree];
        for (int i = 0; i < free; ++i) rows[i] = slope(i);
        bins_->kernel->derivatives(bins_->columns(), total_.data(), free, rows, over_.data(), gradient,
                                   information[0]);
    }

  private:
    double* row(int i) { return rows_.data() + static_cast<std::size_t>(i) * size_; }
    const Bins* bins_;
    std::size_t size_;
    std::vector<double> total_, part_, gain_, floor_, over_, rows_;
};

// Makes the lower half of a positive definite matrix its factor of Cholesky; false if it is none.
inline bool factor(int n, double (*a)[kMostFree]) {
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = a[i][j];
            for (int k = 0; k < j; ++k) sum -= a[i][k] * a[j][k];
            if (i == j) {
                if (!(sum > 0)) return false;
                a[i][i] = std::sqrt(sum);
            } else {
                a[i][j] = sum / a[j][j];
            }
        }
    }
    return true;
}

// Solves L b' = b in place, and with `both` L' b'' = b' too.
inline void substitute(int n, const double (*a)[kMostFree], double* b, bool both) {
    for (int i = 0; i < n; ++i) {
        for (int k = 0; k < i; ++k) b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = n - 1; both && i >= 0; --i) {
        for (int k = i + 1; k < n; ++k) b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

constexpr double kLongest = 3;  // of a step

struct Patience {
    int steps = 60;
    double converged = 1e-5;  // the gain of -log L in a step
    double slowest = 1;       // corners are where the data are, or so many times slower
    // Information about a coordinate that is as good as not there: its steps have no end, and make no other
    // shorter. A search does without, so that it is slow to take a relaxation for a filter of one pole.
    double nothing = 0;

    Patience() = default;
    Patience(int most, double gain, double slower)
        : steps(most), converged(gain), slowest(slower), nothing(1e-4) {}
};

// Moves eta to the best that is reached from there; -log L. `held` keeps its value, -1: none does.
inline double score(const Bins& bins, const Words& words, double* eta, int held, const Patience& patience) {
    const int free = free_of(words);
    double low[kMostFree], high[kMostFree], gradient[kMostFree];
    double information[kMostFree][kMostFree], damped[kMostFree][kMostFree];
    int next = 0;
    for (const Word& word : words) {
        bounds_of(word, bins, patience.slowest, low + next, high + next);
        next += kFree[word.part];
    }
    for (int i = 0; i < free; ++i)
        if (i != held) eta[i] = std::fmin(std::fmax(eta[i], low[i]), high[i]);
    Spectrum here(bins), there(bins);
    double nll = here.at(words, eta), damping = 1e-3;
    int small = 0;
    for (int step = 0; step < patience.steps && std::isfinite(nll); ++step) {
        here.derivatives(free, gradient, information);
        int index[kMostFree], count = 0;
        for (int i = 0; i < free; ++i) {
            const bool stuck =
                (eta[i] <= low[i] && gradient[i] > 0) || (eta[i] >= high[i] && gradient[i] < 0);
            if (i != held && !stuck) index[count++] = i;
        }
        if (count == 0) break;
        double trial[kMostFree], found = nll;
        bool better = false;
        for (; damping < 1e9; damping *= 8) {
            double move[kMostFree];
            for (int a = 0; a < count; ++a) {
                move[a] = gradient[index[a]];
                for (int b = 0; b < count; ++b) damped[a][b] = information[index[a]][index[b]];
                damped[a][a] *= 1 + damping;
                damped[a][a] += 1e-9;
            }
            if (!factor(count, damped)) continue;
            substitute(count, damped, move, true);
            // A step of a factor of e³ is as far as slopes are to be trusted.
            double longest = kLongest;
            for (int a = 0; a < count; ++a)
                if (information[index[a]][index[a]] > patience.nothing)
                    longest = std::fmax(longest, std::fabs(move[a]));
            std::copy(eta, eta + free, trial);
            for (int a = 0; a < count; ++a) {
                const int i = index[a];
                const double step = std::fmax(-kLongest, std::fmin(kLongest, move[a] * kLongest / longest));
                trial[i] = std::fmin(std::fmax(eta[i] - step, low[i]), high[i]);
            }
            found = there.at(words, trial);
            if (found <= nll) {
                better = true;
                break;
            }
        }
        if (!better) break;
        const double gained = nll - found;
        std::copy(trial, trial + free, eta);
        nll = found;
        std::swap(here, there);
        damping = std::fmax(damping / 6, 1e-9);
        // A small step of a damped search is no end.
        small = gained < patience.converged ? small + 1 : 0;
        if (small > 2 || (small && damping < 1e-2)) break;
    }
    return nll;
}

}  // namespace sentence
}  // namespace fltea
