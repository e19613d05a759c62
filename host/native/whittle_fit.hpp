// Finds the parameters of a noise model that maximise Whittle's likelihood (whittle_kernel.hpp) within
// bounds, by Fisher scoring with Levenberg's damping. One parameter may be held fixed, as profile likelihoods
// need it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "whittle_bins.hpp"

namespace fltea {
namespace noise_models {

typedef std::vector<Term> Terms;

inline int free_of(const Terms& terms) {
    int count = 0;
    for (const Term& term : terms) count += free_of(term.part);
    return count;
}

// Returns the noise parts that have at least one of `traits` and none of `without`. If `traits` is 0, they
// need not have any. Parts with the trait kOther are left out in any case.
inline std::vector<Part> parts_with(unsigned traits, unsigned without = 0) {
    std::vector<Part> found;
    for (const Row& row : kTable)
        if ((traits == 0 || row.is(traits)) && !row.is(without | kOther)) found.push_back(row.part);
    return found;
}

// Writes the lowest and highest values of the parameters of a noise part to `low` and `high`. `slowest`:
// correlation times may be up to this many times the longest one that the spectrum can show.
inline void bounds_of(const Term& term, const Bins& bins, double slowest, double* low, double* high) {
    const double power = std::log(bins.mean), least = power - kSmallest, most = power + kLargest;
    const double slow = std::log(bins.lowest / slowest), top = std::log(kPi);
    const double by_h = 4 * std::fabs(bins.log_h);
    const FreeParameters& own = row_of(term.part).free_parameters;
    for (int k = 0; k < own.count; ++k) {
        const FreeParameter& one = own.at[k];
        const auto set = [&](double from, double to) {
            low[k] = from;
            high[k] = to;
        };
        switch (one.value) {
            case kLevel:
            case kPower:
                set(least, most);
                break;
            case kRate:
                set(slow, top);
                break;
            case kPole:
                set(slow, kNoPole);
                break;
            case kAlpha:
                set(std::fmax(one.low, bins.lowest_order), std::fmin(one.high, bins.highest_order));
                break;
            case kNumber:
            case kShape:
                set(one.low, one.high);
                break;
            case kFrequency:
                set(std::log(bins.lowest), top + one.high);
                break;
            case kCorner:
                set(2 * std::log(bins.lowest), one.high);
                break;
            case kMinusF:
                set(one.low, 2 * kLn2 - 2 * std::fmin(bins.log_h, 0.0));
                break;
            case kNoise:
                set(least - by_h, most + by_h);
                break;
        }
    }
}

// Computes the spectrum of a model for given parameters, and the derivatives of the logarithm of the
// spectrum.
class Spectrum {
  public:
    explicit Spectrum(const Bins& bins)
        : bins_(&bins),
          size_(bins.size()),
          stride_(stride_of(size_)),
          total_(size_),
          part_(size_),
          gain_(size_),
          floor_(size_),
          over_(size_) {}

    // Computes the spectrum. Returns -log L, or infinity if there is no spectrum for these parameters.
    double at(const Terms& terms, const double* eta) {
        const Columns columns = bins_->columns();
        std::fill(total_.begin(), total_.end(), 0.0);
        std::fill(gain_.begin(), gain_.end(), 1.0);
        std::fill(floor_.begin(), floor_.end(), 0.0);
        const Kernel& kernel = *bins_->kernel;
        free_ = free_of(terms);
        scaled_ = true;
        rows_.resize(static_cast<std::size_t>(free_) * stride_);
        int next = 0;
        for (const Term& term : terms) {
            double* slope[3] = {nullptr, nullptr, nullptr};
            const int own = free_of(term.part);
            const bool filter = filters(term.part), floor = row_of(term.part).is(kBehind);
            for (int k = 0; k < own; ++k, ++next) {
                slope[k] = row(next);
                by_[next] = filter ? floor_.data() : floor ? part_.data() : over_.data();
            }
            const double* const at = eta + next - own;
            if (!kernel.term(columns, term, at, part_.data(), slope))
                return std::numeric_limits<double>::infinity();
            if (filter) {
                kernel.times(size_, gain_.data(), part_.data(), gain_.data());
            } else {
                kernel.plus(size_, part_.data(), floor ? floor_.data() : total_.data());
            }
        }
        kernel.whole(size_, gain_.data(), total_.data(), floor_.data(), part_.data(), over_.data());
        scaled_ = false;
        return kernel.nll(columns, total_.data());
    }

    const Numbers& total() const { return total_; }
    const Numbers& gain() const { return gain_; }
    // Returns the derivative of the logarithm of the whole spectrum by parameter i, as one number per bin.
    const double* slope(int i) {
        scale();
        return row(i);
    }

    // Writes the first derivatives of -log L by the parameters, and the expected second derivatives of -log
    // L.
    void derivatives(int free, double* gradient, double (*information)[kMostFree]) {
        const double* rows[kMostFree];
        for (int i = 0; i < free; ++i) rows[i] = slope(i);
        bins_->kernel->derivatives(bins_->columns(), total_.data(), free, rows, over_.data(), gradient,
                                   information[0]);
    }

  private:
    double* row(int i) { return rows_.data() + static_cast<std::size_t>(i) * stride_; }

    // Converts the derivatives of single parts and gains into those of the logarithm of the whole spectrum.
    // This function is called when such a derivative is first needed.
    void scale() {
        for (int k = 0; k < free_ && !scaled_; ++k) bins_->kernel->times(size_, row(k), by_[k], row(k));
        scaled_ = true;
    }

    const Bins* bins_;
    std::size_t size_, stride_;
    Numbers total_, part_, gain_, floor_, over_, rows_;
    const double* by_[kMostFree] = {};
    int free_ = 0;
    bool scaled_ = true;
};

// Replaces the lower half of a matrix by its Cholesky factor. Returns false if the matrix is not positive
// definite.
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

// Solves L x = b, where L is the Cholesky factor in `a`, and writes x to `b`. If `both` is true, solves L L'
// x = b instead.
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

constexpr double kLongest = 3;  // in one step of a fit, no parameter changes by more than this number

struct Patience {
    int steps = 60;
    double converged = 1e-5;  // a step that lowers -log L by less than this counts as small
    // Limit of correlation times, in units of the longest one that the spectrum can show (the inverse of its
    // lowest frequency in rad per sample).
    double slowest = 1;
    // A parameter of which the data say little would change so much in a step that the step had to be
    // shortened for all parameters. The step is therefore not shortened for parameters whose Fisher
    // information is less than this. In a model search, this is 0, so the step is always shortened.
    // Otherwise, the search would too readily take a relaxation for a low-pass of one pole.
    double nothing = 0;

    Patience() = default;
    Patience(int most, double gain, double slower)
        : steps(most), converged(gain), slowest(slower), nothing(1e-4) {}
};

// The spectra at the best parameters so far (`here`) and at the parameters that are tried next (`there`).
// Consecutive fits use the same memory for both.
struct Room {
    const Bins& bins;
    Spectrum here, there;

    explicit Room(const Bins& of) : bins(of), here(of), there(of) {}
};

// The bounds of all free parameters of a model.
struct Bounds {
    double low[kMostFree], high[kMostFree];

    Bounds(const Terms& terms, const Bins& bins, double slowest) {
        int next = 0;
        for (const Term& term : terms) {
            bounds_of(term, bins, slowest, low + next, high + next);
            next += free_of(term.part);
        }
    }

    double nearest(int i, double value) const { return std::fmin(std::fmax(value, low[i]), high[i]); }
    // Whether parameter i is at one of its bounds, and -log L would become lower only on the other side of
    // it.
    bool stops(int i, double value, double gradient) const {
        return (value <= low[i] && gradient > 0) || (value >= high[i] && gradient < 0);
    }
};

// The derivatives of -log L at the present parameters of a fit, from which damped steps are computed.
class Slopes {
  public:
    // `held`: index of the parameter that keeps its value, or -1.
    Slopes(Spectrum& here, const Bounds& bounds, const double* eta, int free, int held)
        : bounds_(bounds), eta_(eta), free_(free) {
        here.derivatives(free, gradient_, information_);
        for (int i = 0; i < free; ++i)
            if (i != held && !bounds.stops(i, eta[i], gradient_[i])) index_[count_++] = i;
    }

    // Whether a step can change any parameter.
    bool any() const { return count_ > 0; }

    // Writes the parameters after a step to `trial`. Returns false if the damping is too weak for a step.
    bool step(double damping, double nothing, double* trial) const {
        double move[kMostFree], damped[kMostFree][kMostFree];
        for (int a = 0; a < count_; ++a) {
            move[a] = gradient_[index_[a]];
            for (int b = 0; b < count_; ++b) damped[a][b] = information_[index_[a]][index_[b]];
            damped[a][a] *= 1 + damping;
            damped[a][a] += 1e-9;
        }
        if (!factor(count_, damped)) return false;
        substitute(count_, damped, move, true);
        // The step is shortened so that no parameter changes by more than 3. Parameters are logarithms and
        // the like, and after a larger change the derivatives say nothing.
        double longest = kLongest;
        for (int a = 0; a < count_; ++a)
            if (information_[index_[a]][index_[a]] > nothing)
                longest = std::fmax(longest, std::fabs(move[a]));
        std::copy(eta_, eta_ + free_, trial);
        for (int a = 0; a < count_; ++a) {
            const int i = index_[a];
            const double step = std::fmax(-kLongest, std::fmin(kLongest, move[a] * kLongest / longest));
            trial[i] = bounds_.nearest(i, eta_[i] - step);
        }
        return true;
    }

  private:
    const Bounds& bounds_;
    const double* eta_;
    int free_, count_ = 0;
    int index_[kMostFree];  // the parameters that a step may change
    double gradient_[kMostFree], information_[kMostFree][kMostFree];
};

// Fits a model. Searches for the best parameters, starting from those in `eta`, writes the best ones to
// `eta`, and returns their -log L. The parameter with index `held` keeps its value. If `held` is -1, all
// parameters are free.
inline double score(Room& room, const Terms& terms, double* eta, int held, const Patience& patience) {
    const int free = free_of(terms);
    const Bounds bounds(terms, room.bins, patience.slowest);
    for (int i = 0; i < free; ++i)
        if (i != held) eta[i] = bounds.nearest(i, eta[i]);
    Spectrum &here = room.here, &there = room.there;
    double nll = here.at(terms, eta), damping = 1e-3;
    int small = 0;
    for (int step = 0; step < patience.steps && std::isfinite(nll); ++step) {
        const Slopes slopes(here, bounds, eta, free, held);
        if (!slopes.any()) break;
        double trial[kMostFree], found = nll;
        bool better = false;
        for (; damping < 1e9; damping *= 8) {
            if (!slopes.step(damping, patience.nothing, trial)) continue;
            found = there.at(terms, trial);
            better = found <= nll;
            if (better) break;
        }
        if (!better) break;
        const double gained = nll - found;
        std::copy(trial, trial + free, eta);
        nll = found;
        std::swap(here, there);
        damping = std::fmax(damping / 6, 1e-9);
        // A single small step does not end the fit while the damping is strong.
        small = gained < patience.converged ? small + 1 : 0;
        if (small > 2 || (small && damping < 1e-2)) break;
    }
    return nll;
}
inline double score(const Bins& bins, const Terms& terms, double* eta, int held, const Patience& patience) {
    Room room(bins);
    return score(room, terms, eta, held, patience);
}

}  // namespace noise_models
}  // namespace fltea
