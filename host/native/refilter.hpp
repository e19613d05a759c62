// Filters remembered means of samples with the linear system of a new noise model. Computes statistics of the
// innovations and the likelihood of the samples.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "kalman.hpp"
#include "mean_ahead.hpp"
#include "past.hpp"
#include "rest_gate.hpp"

namespace fltea {
namespace track {

namespace refilter {

// A mean is taken over m samples. A state counts as fast if its relaxation time is shorter than m / kSlow
// samples. In the means, a fast state contributes white noise.
constexpr double kSlow = 6;
// Relative rounding error of the elements of a covariance. Elements that are relatively smaller than this
// count as 0.
constexpr double kRounding = 1e-9;

// Describes how means of m samples depend on the slow states of a noise model's system. One step of this new
// system takes the time of m samples, and its measurement is their mean. `of`: indexes of the n slow states
// in the noise model's system. Apart from measurement noise, the mean is the sum of two terms: one follows
// from the slow states at the end of the m samples, and the other is independent from step to step. The
// latter is an additional, last state.
struct Coarse {
    System<kMost> system;
    int n, of[kMost];
};

inline bool is_slow(const System<kMost>& s, int i, double m) {
    return i >= 2 * s.pairs && s.c[i] != 0 && s.a[i] > 0 && (1 - s.a[i]) * m < kSlow;
}

// Describes the sum of m samples: how each state before the first sample contributes to the sum, and which
// covariances the noise adds to the states and to the sum. It is computed by doubling m.
struct Sums {
    explicit Sums(const System<kMost>& s) : step(s) {
        const int n = s.n;
        const double* const c = s.c;
        for (int i = 0; i < n; ++i) {
            row[i] = c[i];
            both[i] = dot(s.Q + i * n, c, n);
        }
        variance = dot(both, c, n);
        back(row);
    }
    void twice() {
        const int n = step.n;
        double driven[kMost], before[kMost], Q[kMost * kMost];
        for (int i = 0; i < n; ++i) driven[i] = dot(step.Q + i * n, row, n);
        variance = 2 * variance + dot(driven, row, n) + 2 * dot(both, row, n);
        for (int i = 0; i < n; ++i) driven[i] += both[i];
        forth(driven);
        std::memcpy(before, row, sizeof before);
        back(row);
        for (int i = 0; i < n; ++i) {
            both[i] += driven[i];
            row[i] += before[i];
        }
        std::memcpy(Q, step.Q, sizeof Q);
        step.step_covariance(Q);
        std::memcpy(step.Q, Q, sizeof Q);
        for (int i = 0; i < n; ++i) {
            const double a = step.a[i], b = step.b[i];
            step.a[i] = a * a - b * b;
            step.b[i] = 2 * a * b;
        }
        samples *= 2;
    }

    // A system whose step has the length of `samples` samples. Of its members, only the matrices A
    // (transition) and Q (covariance of the noise of a step) are used.
    System<kMost> step;
    double samples = 1, row[kMost], both[kMost], variance;

  private:
    // Computes x <- A x, where A is the transition matrix of the step.
    void forth(double* x) const {
        for (int i = 0; i < step.n; ++i) {
            if (i < 2 * step.pairs) {
                const double one = step.a[i] * x[i] + step.b[i] * x[i + 1];
                x[i + 1] = step.a[i] * x[i + 1] - step.b[i] * x[i];
                x[i++] = one;
            } else {
                x[i] *= step.a[i];
            }
        }
    }
    // Computes x <- A' x, where A' is the transposed transition matrix of the step.
    void back(double* x) const {
        for (int i = 0; i < step.n; ++i) {
            if (i < 2 * step.pairs) {
                const double one = step.a[i] * x[i] - step.b[i] * x[i + 1];
                x[i + 1] = step.a[i] * x[i + 1] + step.b[i] * x[i];
                x[i++] = one;
            } else {
                x[i] *= step.a[i];
            }
        }
    }
};

// Computes from the system `s` of a noise model the system of its slow states (Coarse), which filters means
// of m samples. `m` is a power of 2.
inline void coarsen(const System<kMost>& s, double m, Coarse& to) {
    System<kMost>& q = to.system;
    Sums sums(s);
    while (sums.samples < m) sums.twice();
    // weights in the mean: how much each fast state, as it was before the m samples, contributes to their
    // mean
    double fast[kMost];
    int n = 0;
    for (int i = 0; i < s.n; ++i) {
        fast[i] = is_slow(s, i, m) ? 0 : sums.row[i] / m;
        if (is_slow(s, i, m)) to.of[n++] = i;
    }
    to.n = n;
    // If there are kMost slow states, the additional state (Coarse) has no place. Its noise is then treated
    // as white, and added to the measurement noise R.
    const bool room = n < kMost;
    q.n = n + (room ? 1 : 0);
    q.pairs = 0;
    for (int k = 0; k < n; ++k) {
        const int i = to.of[k];
        q.a[k] = sums.step.a[i];
        q.b[k] = 0;
        q.c[k] = sums.row[i] / (m * q.a[k]);
        q.state[k] = s.state[i];
        q.bias[k] = s.bias[i];
    }
    double within = sums.variance / (m * m);
    for (int k = 0; k < n; ++k) {
        double driven = 0;
        for (int l = 0; l < n; ++l) {
            const double both = sums.step.Q[to.of[k] * s.n + to.of[l]];
            q.Q[k * q.n + l] = both;
            driven += both * q.c[l];
        }
        const double own = sums.both[to.of[k]] / m;
        within += q.c[k] * (driven - 2 * own);
        if (room) q.Q[k * q.n + n] = q.Q[n * q.n + k] = own - driven;
    }
    within = within > 0 ? within : 0;
    q.R = s.R / m + form(fast, s.P0, fast, s.n);
    if (room) {
        q.a[n] = q.b[n] = q.state[n] = q.bias[n] = 0;
        q.c[n] = 1;
        q.Q[n * q.n + n] = within;
    } else {
        q.R += within;
    }
}

// Determines the usual power of the innovations at rest, and the usual power of their mean. Both are medians
// over chunks, so undetected motion hardly changes them.
class Innovations {
  public:
    // `z`: innovation divided by its standard deviation, or NaN where a sample is missing.
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
    // Returns the usual powers, or `before` if there were too few chunks to determine them.
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

// The newest steps of the bias. `at`: number of the first sample after the step. `variance`: variance that is
// assumed for the size of the step.
class Steps {
  public:
    enum { kMostSteps = 16 };
    struct Step {
        std::int64_t at;
        double variance;
    };

    void add(std::int64_t at, double variance) {
        if (count_ == kMostSteps) {
            for (int i = 1; i < count_; ++i) steps_[i - 1] = steps_[i];
            --count_;
        }
        steps_[count_++] = Step{at, variance};
    }
    void clear() { count_ = 0; }
    // Drops all steps at the sample number `from` or later.
    void forget(std::int64_t from) {
        int kept = 0;
        for (int i = 0; i < count_; ++i) {
            if (steps_[i].at < from) steps_[kept++] = steps_[i];
        }
        count_ = kept;
    }
    bool is(const Steps& other) const {
        for (int i = 0; i < count_ && i < other.count_; ++i) {
            if (steps_[i].at != other.steps_[i].at || steps_[i].variance != other.steps_[i].variance)
                return false;
        }
        return count_ == other.count_;
    }
    // Returns the sum of the variances of all steps at the sample numbers from `begin` to before `end`, or 0
    // if there is no step.
    double within(std::int64_t begin, std::int64_t end) const {
        double sum = 0;
        for (int i = 0; i < count_; ++i) {
            if (begin <= steps_[i].at && steps_[i].at < end) sum += steps_[i].variance;
        }
        return sum;
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(count_, 0, kMostSteps);
        for (int i = 0; i < count_ && io.sound(); ++i) {
            io.number(steps_[i].at, 0, 1e15);
            io.real(steps_[i].variance, 0, 1e300);
        }
    }

  private:
    Step steps_[kMostSteps];
    int count_ = 0;
};

inline bool is_finite(const double* x, int n) {
    for (int i = 0; i < n; ++i) {
        if (!std::isfinite(x[i])) return false;
    }
    return true;
}

// Whether a symmetric matrix can be a covariance. It can if it has no negative eigenvalue, apart from
// rounding. Elimination shows this.
inline bool is_covariance(const double* P, int n) {
    double left[kMost * kMost];
    std::memcpy(left, P, sizeof(double) * std::size_t(n * n));
    for (int k = 0; k < n; ++k) {
        const double pivot = left[k * n + k], rounding = kRounding * P[k * n + k];
        if (!(pivot >= -rounding) || !std::isfinite(pivot)) return false;
        if (pivot <= rounding) continue;
        for (int i = k + 1; i < n; ++i) {
            const double share = left[i * n + k] / pivot;
            for (int j = k + 1; j < n; ++j) left[i * n + j] -= share * left[k * n + j];
        }
    }
    return true;
}

// Filters the queue `means`, whose entries are means of m samples, with the slow states of the system `s`
// (Coarse). x and P are the estimate and covariance of the whole system's state before these means, and are
// replaced by those after them. `first`: number of the first sample in the means. A mean whose samples
// contain a step of the bias is ignored.
template <int size>
void through(const System<kMost>& s, const Newest<size>& means, std::int64_t m, std::int64_t first,
             const Steps& steps, double* x, double* P, Likelihood& fits) {
    if (means.count() == 0) return;
    Coarse part;
    coarsen(s, double(m), part);
    const int n = part.n, all = part.system.n, offset = part.system.offset();
    double own[kMost * kMost];
    std::memcpy(own, part.system.Q, sizeof own);
    for (int k = 0; k < n; ++k) {
        for (int l = 0; l < n; ++l) own[k * all + l] = P[part.of[k] * s.n + part.of[l]];
    }
    Kalman<kMost> filter;
    RiccatiMap<kMost> map;
    if (!map.set(part.system)) return;
    for (int k = 0; k < n; ++k) filter.x[k] = x[part.of[k]];
    filter.start(&part.system, &map, own);
    for (int i = 0; i < means.count(); ++i, first += m) {
        const double before = steps.within(first, first + 1), inside = steps.within(first + 1, first + m);
        if (before > 0 && offset >= 0) filter.widen(offset, before);
        const double y = means[i], e = filter.innovation(std::isnan(y) ? 0 : y);
        const bool known = !std::isnan(y) && !(inside > 0);
        if (known) fits.add(e, filter.S);
        filter.go_on(e, known);
        if (inside > 0 && offset >= 0) filter.widen(offset, inside);
    }
    double x_then[kMost], P_then[kMost * kMost];
    std::memcpy(x_then, x, sizeof x_then);
    std::memcpy(P_then, P, sizeof(double) * std::size_t(s.n * s.n));
    for (int k = 0; k < n; ++k) {
        x_then[part.of[k]] = filter.x[k];
        for (int l = 0; l < n; ++l) P_then[part.of[k] * s.n + part.of[l]] = filter.P[k * all + l];
    }
    // A pair of poles always counts as fast. If such a pair in fact decays slowly, so much precision may be
    // lost that the result is invalid. x and P then stay as they were before the means.
    if (!is_finite(x_then, s.n) || !is_covariance(P_then, s.n)) return;
    std::memcpy(x, x_then, sizeof x_then);
    std::memcpy(P, P_then, sizeof(double) * std::size_t(s.n * s.n));
}

}  // namespace refilter

}  // namespace track
}  // namespace fltea
