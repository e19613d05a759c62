// A system's filter over all that is remembered of the samples, and how likely it made them.
#pragma once

#include <algorithm>

#include "kalman.hpp"
#include "past.hpp"
#include "rest_gate.hpp"

namespace fltea {
namespace track {

namespace refilter {

// Of coordinates whose relaxation takes more than this part of the time of a mean, the mean says nothing.
constexpr double kSlow = 0.2;

// The slow part of a system, one mean of m samples a step. `of`: its coordinates in the whole.
struct Coarse {
    System<kMost> system;
    int of[kMost];
};

inline bool is_slow(const System<kMost>& s, int i, double m) {
    return i >= 2 * s.pairs && s.c[i] != 0 && s.a[i] > 0 && (1 - s.a[i]) * m < kSlow;
}

inline void coarsen(const System<kMost>& s, double m, Coarse& to) {
    System<kMost>& q = to.system;
    q.n = q.pairs = 0;
    // Spectral density at 0 of all that is not slow, and what a mean differs from the end of its samples.
    double density = s.R, within = 0;
    for (int i = 0; i < s.n; ++i) {
        if (!is_slow(s, i, m)) continue;
        const int k = q.n++;
        to.of[k] = i;
        q.a[k] = std::pow(s.a[i], m);
        q.b[k] = 0;
        q.c[k] = s.c[i];
        q.state[k] = s.state[i];
        q.bias[k] = s.bias[i];
        within += s.c[i] * s.c[i] * s.Q[i * s.n + i] * m / 3;
    }
    for (int k = 0; k < q.n; ++k) {
        for (int l = 0; l < q.n; ++l) {
            const int i = to.of[k], j = to.of[l];
            const double both = s.a[i] * s.a[j], left = 1 - both;
            const double steps = left > 1e-12 ? (1 - std::pow(both, m)) / left : m;
            q.Q[k * q.n + l] = s.Q[i * s.n + j] * steps;
            q.P0[k * q.n + l] = s.P0[i * s.n + j];
        }
    }
    // Of the fast ones with A x = x' one by one: c (1 - A)^-1 Q (1 - A)^-T c'.
    double M[kMost * kMost], row[kMost];
    for (int i = 0; i < s.n; ++i) {
        const bool fast = !is_slow(s, i, m);
        row[i] = fast ? s.c[i] : 0;
        for (int j = 0; j < s.n; ++j) M[i * s.n + j] = i == j ? (fast ? 1 - s.a[i] : 1) : 0;
    }
    for (int i = 0; i < 2 * s.pairs; i += 2) {  // transposed
        M[(i + 1) * s.n + i] = -s.b[i];
        M[i * s.n + i + 1] = s.b[i];
    }
    if (solve(M, row, s.n, 1)) density += form(row, s.Q, row, s.n);
    q.R = density / m + within;
}

// How large innovations at rest are, by the median of chunks, which motion that was not seen does not move.
class Innovations {
  public:
    // z: in its deviations, or NaN.
    void add(double z) {
        if (std::isnan(z)) {
            known_ = false;
        } else {
            sum_ += z;
            powers_ += z * z;
            if (z * z > largest_) largest_ = z * z;
        }
        if (++fill_ < RestGate::kChunk) return;
        if (known_ && count_ < kMostChunks) {
            power_[count_] = (powers_ - largest_) / (RestGate::kChunk - 1);
            mean_[count_++] = sum_ * sum_ / RestGate::kChunk;
        }
        fill_ = 0;
        known_ = true;
        sum_ = powers_ = largest_ = 0;
    }
    // Of too few it is what it was.
    Usual usual(const Usual& before) {
        if (count_ < kFewestChunks) return before;
        Usual found;
        found.power = std::fmin(std::fmax(median(power_), 1), 1e300);
        found.mean = std::fmin(std::fmax(median(mean_), 1), 1e300);
        return found;
    }

  private:
    enum { kMostChunks = Past::kSingle / RestGate::kChunk + 2, kFewestChunks = 8 };
    double median(double* values) {
        std::nth_element(values, values + count_ / 2, values + count_);
        return values[count_ / 2];
    }

    double power_[kMostChunks], mean_[kMostChunks];
    double sum_ = 0, powers_ = 0, largest_ = 0;
    int fill_ = 0, count_ = 0;
    bool known_ = true;
};

class Likelihood {
  public:
    void add(double e, double S) { sum_ -= 0.5 * (e * e / S + log_S_.of(S)); }
    double value() const { return sum_; }

  private:
    double sum_ = 0;
    HeldLog log_S_;
};

// Means of m samples go through the filter of the slow part; x and P of all of it are before and after.
template <int size>
void through(const System<kMost>& s, const Newest<size>& means, double m, double* x, double* P,
             Likelihood& fits) {
    if (means.count() == 0) return;
    Coarse part;
    coarsen(s, m, part);
    const int n = part.system.n;
    double own[kMost * kMost];
    for (int k = 0; k < n; ++k) {
        for (int l = 0; l < n; ++l) own[k * n + l] = P[part.of[k] * s.n + part.of[l]];
    }
    Kalman<kMost> filter;
    RiccatiMap<kMost> map;
    if (!map.set(part.system)) return;
    for (int k = 0; k < n; ++k) filter.x[k] = x[part.of[k]];
    filter.start(&part.system, &map, own);
    for (int i = 0; i < means.count(); ++i) {
        const double y = means[i], e = filter.innovation(std::isnan(y) ? 0 : y);
        if (!std::isnan(y)) fits.add(e, filter.S);
        filter.go_on(e, !std::isnan(y));
    }
    for (int k = 0; k < n; ++k) {
        x[part.of[k]] = filter.x[k];
        for (int l = 0; l < n; ++l) P[part.of[k] * s.n + part.of[l]] = filter.P[k * n + l];
    }
}

}  // namespace refilter

// The samples that a filter begins again with: those of the past, and the last ones, which are not in it yet
// in case there was motion; NaN where nothing is known.
struct Remembered {
    enum { kRecent = 2 * RestGate::kChunk };

    // Leaves the filter after the newest sample, and returns log L but for a constant. `innovations`: of the
    // newest samples, if anybody wants them.
    double filter_again(const System<kMost>& s, const RiccatiMap<kMost>& map, Kalman<kMost>& filter,
                        refilter::Innovations* innovations = nullptr) const {
        double x[kMost] = {0}, P[kMost * kMost];
        std::memcpy(P, s.P0, sizeof(double) * std::size_t(s.n * s.n));
        refilter::Likelihood fits;
        double m = std::pow(double(Past::kGroup), double(Past::kLevels));
        for (int level = Past::kLevels - 1; level >= 0; --level) {
            refilter::through(s, past.means(level), m, x, P, fits);
            m /= Past::kGroup;
        }
        std::memcpy(filter.x, x, sizeof x);
        filter.start(&s, &map, P);
        const int single = past.single().count();
        for (int i = 0; i < single + kept; ++i) {
            const double y = i < single ? past.single()[i] : double(recent[i - single]);
            const double e = filter.innovation(std::isnan(y) ? 0 : y);
            if (!std::isnan(y)) fits.add(e, filter.S);
            if (innovations != nullptr) innovations->add(std::isnan(y) ? y : e / std::sqrt(filter.S));
            filter.go_on(e, !std::isnan(y));
        }
        return fits.value();
    }

    // 2 log L, but for a constant; NaN if no filter can work with the system.
    double likelihood(const System<kMost>& s) const {
        RiccatiMap<kMost> map;
        if (!map.set(s)) return __builtin_nan("");
        Kalman<kMost> filter;
        return 2 * filter_again(s, map, filter);
    }

    Past past;
    float recent[kRecent];
    int kept = 0;
};

}  // namespace track
}  // namespace fltea
