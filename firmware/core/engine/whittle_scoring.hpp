// Minimizes -log L by Fisher scoring with Levenberg's damping. Scoring replaces the curvature of -log L by
// its expectation, which is never negative and needs no second derivatives.
//
// If the scale of the spectrum S is free, the search does not vary it: for given other parameters, the best
// scale is Σ c I/S / m. With this scale, -log L = Σ c log S + m log(Σ c I/S / m) + m. The sums are over bins,
// each the mean I of c ordinates, and m is the number of all ordinates. The Fisher information matrix, too,
// is that of the other parameters alone. It follows from the full matrix by a subtraction, since the
// derivative of log S by the logarithm of the scale is 1 in every bin.
#ifndef FLTEA_WHITTLE_SCORING_HPP
#define FLTEA_WHITTLE_SCORING_HPP

#include "whittle_models.hpp"

namespace fltea {
namespace whittle {

template <class R>
struct Point {
    enum { kFree = Room<R>::kFree };

    R theta[kFree];
    R nll;
    R scale;
    R gradient[kFree];
    R fisher[kFree][kFree];
};

const double kLeastCurvature = 1e-30;

// Computes -log L at point.theta and its derivatives, from the sums over the bins. `target`: the data to
// which the model is fitted. It has the number of ordinates, and the function nll(), which turns sums into
// -log L.
template <class Target, class R>
void conclude(const Target& target, const Model<R>& model, const Mapped<R>& at, Sums<R>& sums,
              Point<R>& point) {
    const bool free_scale = scaled(model);
    const R m = target.ordinates;
    point.scale = free_scale ? sums.ratio / m : 1;
    const R nll = target.nll(sums, point.scale, free_scale);
    if (!math::finite(nll)) return;
    const int numbers = shapes(model.family) + parts(model.family) + 1, free = free_of(model);
    for (int i = 0; i < numbers; ++i) {
        for (int j = 0; j <= i; ++j) {
            if (free_scale) sums.square[i][j] -= sums.slope[i] * sums.slope[j] / m;
            sums.square[j][i] = sums.square[i][j];
        }
    }
    for (int a = 0; a < free; ++a) {
        R slope = 0, row[Most<R>::kNumbers];
        for (int i = 0; i < numbers; ++i) {
            slope += at.chain[i][a] * (sums.slope[i] - sums.weighted[i] / point.scale);
            row[i] = 0;
            for (int j = 0; j < numbers; ++j) row[i] += sums.square[i][j] * at.chain[j][a];
        }
        point.gradient[a] = slope;
        for (int b = 0; b <= a; ++b) {
            R total = 0;
            for (int i = 0; i < numbers; ++i) total += at.chain[i][b] * row[i];
            point.fisher[a][b] = point.fisher[b][a] = total;
        }
    }
    point.nll = nll;
}

// Maps the free parameters point.theta to a spectrum, and computes -log L and its derivatives there. If there
// is no such spectrum, -log L is impossible().
template <class Target, class R>
void evaluate(const Target& target, const Model<R>& model, Point<R>& point) {
    Mapped<R> at;
    Sums<R> sums;
    point.nll = Room<R>::impossible();
    if (!map(model, point.theta, at)) return;
    target.sums(model.family, at.natural, sums);
    conclude(target, model, at, sums, point);
}

// Solves (A + damping diag A) x = -b for the step x of the free parameters. A is the Fisher information and b
// the gradient of -log L. `given`: flags of the parameters whose step the caller has already written into
// `step`. If a diagonal element of A is only a rounding error, the step of its parameter becomes very long,
// and the caller has to limit it.
template <class R>
void solve(const Point<R>& at, const bool* given, int free, R damping, R* step) {
    R L[Room<R>::kFree][Room<R>::kFree];
    for (int i = 0; i < free; ++i) {
        R x = given[i] ? step[i] : -at.gradient[i];
        for (int j = 0; j < free; ++j)
            if (!given[i] && given[j]) x -= at.fisher[i][j] * step[j];
        for (int j = 0; j <= i; ++j) {
            R a = given[i] || given[j] ? R(i == j) : at.fisher[i][j];
            if (i == j && !given[i]) a += damping * a + R(kLeastCurvature);
            const R whole = a;
            for (int k = 0; k < j; ++k) a -= L[i][k] * L[j][k];
            const R least = math::fmax(R(1e-12) * whole, R(kLeastCurvature));
            L[i][j] = i == j ? math::sqrt(math::fmax(a, least)) : a / L[j][j];
        }
        step[i] = x;
    }
    for (int i = 0; i < free; ++i) {
        for (int k = 0; k < i; ++k) step[i] -= L[i][k] * step[k];
        step[i] /= L[i][i];
    }
    for (int i = free - 1; i >= 0; --i) {
        for (int k = i + 1; k < free; ++k) step[i] -= L[k][i] * step[k];
        step[i] /= L[i][i];
    }
}

// Returns how far a free parameter may move up or down in one step. Steps are limited because the derivatives
// are not valid for long ones. The order moves by at most 0.3, any other parameter usually by at most 1. If a
// parameter is more than 2 away from the middle of its range, it is like the logarithm of a small number.
// Then it may move away from the middle by half its distance from it. A step towards the middle is
// unlimited, because applied() then lets the small number grow by the proportion `step`.
template <class R>
R longest(const Model<R>& model, int i, R theta, bool up) {
    if (i == 0 && order_first(model)) return R(0.3);
    // the logarithm of a low-pass's corner frequency may move by 1 wherever it is
    if (i == 0 && low_pass(model.family)) return R(1);
    const R tail = theta - centre(model, i);
    if (math::fabs(tail) > 2 && up == (tail < 0)) return Room<R>::impossible();
    return math::fmax(R(1), math::fabs(tail) / 2);
}

template <class R>
R applied(const Model<R>& model, int i, R theta, R step) {
    if (i == 0 && (order_first(model) || low_pass(model.family))) return step;
    const R tail = theta - centre(model, i);
    if (!(math::fabs(tail) > 2 && (step > 0) == (tail < 0))) return step;
    return step > 0 ? math::log1p(step) : -math::log1p(-step);
}

// What a step promises: the decrease of -log L that the derivatives predict, and whether the step is whole,
// that is, whether no limit (of longest(), or of a parameter's range) has shortened it.
template <class R>
struct Promise {
    R decrease;
    bool whole;
};

template <class R>
Promise<R> damped_step(const Model<R>& model, const Point<R>& at, const R* low, const R* high, R damping,
                       R* step) {
    const int free = free_of(model);
    bool given[Room<R>::kFree];
    for (int i = 0; i < free; ++i) {
        given[i] =
            (at.theta[i] <= low[i] && at.gradient[i] > 0) || (at.theta[i] >= high[i] && at.gradient[i] < 0);
        step[i] = 0;
    }
    Promise<R> promise = {0, true};
    for (int pass = 0; pass <= free; ++pass) {
        solve(at, given, free, damping, step);
        int worst = -1;
        R excess = 1, end = 0;
        for (int i = 0; i < free; ++i) {
            const bool up = step[i] > 0;
            R most = longest(model, i, at.theta[i], up);
            if (most < Room<R>::impossible())
                most = math::fmin(most, up ? high[i] - at.theta[i] : at.theta[i] - low[i]);
            if (!given[i] && math::fabs(step[i]) > excess * most) {
                excess = math::fabs(step[i]) / math::fmax(most, R(1e-30));
                worst = i;
                end = up ? most : -most;
            }
        }
        if (worst < 0) break;
        promise.whole = false;
        given[worst] = true;
        step[worst] = end;
    }
    for (int i = 0; i < free; ++i) {
        promise.decrease -= step[i] * at.gradient[i];
        for (int j = 0; j < free; ++j) promise.decrease -= R(0.5) * step[i] * at.fisher[i][j] * step[j];
    }
    return promise;
}

// When a search stops.
template <class R>
struct Patience {
    int steps;    // largest number of evaluations
    R tolerance;  // the search ends when a step promises to decrease -log L by less than this
    R inside;     // the search ends when -log L is below this
    // The search is given up after two hopeless steps, one after the other. A step is hopeless if no limit
    // has shortened it, and if -log L would be above this number even after 20 times the decrease that the
    // derivatives predict for the step.
    R outside;
};

template <class R>
Patience<R> patience(int steps) {
    return Patience<R>{steps, R(1e-6), -Room<R>::impossible(), Room<R>::impossible()};
}

// The search for the minimum of -log L, step by step: propose() writes a point, and the caller evaluates -log
// L there and passes the result to judge().
template <class R>
class Search {
  public:
    explicit Search(const Model<R>& model) : damping_(R(1e-3)), used_(0), hopeless_(0), over_(false) {
        bounds(model, low_, high_);
    }

    // Number of evaluations so far.
    int used() const { return used_; }

    // Computes the parameters of the next point to evaluate. Returns false at the end of the search.
    bool propose(const Model<R>& model, const Patience<R>& until, const Point<R>& at, Point<R>& next) {
        if (over_ || !(used_ < until.steps && at.nll > until.inside && at.nll < Room<R>::impossible())) {
            return false;
        }
        R step[Room<R>::kFree];
        const Promise<R> promise = damped_step(model, at, low_, high_, damping_, step);
        if (!(promise.decrease > until.tolerance) && damping_ <= R(1e-3)) return false;
        hopeless_ = promise.whole && at.nll - 20 * promise.decrease > until.outside ? hopeless_ + 1 : 0;
        if (hopeless_ == 2) return false;
        for (int i = 0; i < Room<R>::kFree; ++i) next.theta[i] = at.theta[i];
        for (int i = 0; i < free_of(model); ++i) {
            const R moved = at.theta[i] + applied(model, i, at.theta[i], step[i]);
            next.theta[i] = math::fmin(math::fmax(moved, low_[i]), high_[i]);
        }
        return true;
    }

    void judge(const Point<R>& next, Point<R>& at) {
        ++used_;
        if (next.nll < at.nll) {
            at = next;
            damping_ = math::fmax(damping_ * R(0.2), R(1e-7));
        } else {
            damping_ = math::fmax(damping_, R(1e-3)) * 8;
            over_ = damping_ > R(1e6);
        }
    }

  private:
    R low_[Room<R>::kFree], high_[Room<R>::kFree];
    R damping_;
    int used_, hopeless_;
    bool over_;
};

// Searches for the minimum from the evaluated point `at`, and sets `at` to the best point. Returns the number
// of evaluations.
template <class Target, class R>
int score(const Target& target, const Model<R>& model, const Patience<R>& until, Point<R>& at) {
    Search<R> search(model);
    Point<R> next;
    while (search.propose(model, until, at, next)) {
        evaluate(target, model, next);
        search.judge(next, at);
    }
    return search.used();
}

}  // namespace whittle
}  // namespace fltea

#endif
