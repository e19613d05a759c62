// Fisher scoring with Levenberg's damping: the curvature of -log L is replaced by its expectation, which is
// never negative, and which the slopes give without second derivatives.
//
// Where the scale is free it is taken out: at the best one -log L = Σ c log S + m log(Σ c I/S / m) + m, with
// m ordinates, and of the information what belongs to the scale, whose slope is 1 in every bin, is left out.
#pragma once

#include "whittle_models.hpp"

namespace fltea {
namespace whittle {

// One spectrum to fit.
struct Target {
    const Kernel* kernel;
    const Bins* bins;
    const double* power;
    double ordinates;
};

template <class R>
struct Point {
    R theta[kFree];
    R nll;
    R scale;
    R gradient[kFree];
    R fisher[kFree][kFree];
};

const double kImpossible = 1e300;

// -log L at point.theta, and its slopes; kImpossible where there is no such spectrum.
template <class R>
void evaluate(const Target& target, const Model<R>& model, Point<R>& point) {
    Mapped<R> at;
    Sums sums;
    point.nll = R(kImpossible);
    if (!map(model, point.theta, at)) return;
    target.kernel->sums(model.family, *target.bins, target.power, at.natural, sums);
    const bool free_scale = scaled(model);
    const R m = target.ordinates;
    point.scale = free_scale ? sums.ratio / m : 1;
    const R nll =
        free_scale ? sums.log_spectrum + m * std::log(point.scale) + m : sums.log_spectrum + sums.ratio;
    if (!std::isfinite(nll)) return;
    const int numbers = shapes(model.family) + parts(model.family) + 1, free = free_of(model);
    for (int i = 0; i < numbers; ++i) {
        for (int j = 0; j <= i; ++j) {
            if (free_scale) sums.square[i][j] -= sums.slope[i] * sums.slope[j] / m;
            sums.square[j][i] = sums.square[i][j];
        }
    }
    for (int a = 0; a < free; ++a) {
        R slope = 0, row[kMost];
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

// Solves (A + damping diag A) x = -b for the coordinates that may move; the others get 0. A is not negative.
template <class R>
void damped_step(const Point<R>& at, const bool* fixed, int free, R damping, R* step) {
    R L[kFree][kFree];
    for (int i = 0; i < free; ++i) {
        step[i] = fixed[i] ? 0 : -at.gradient[i];
        for (int j = 0; j <= i; ++j) {
            R a = fixed[i] || fixed[j] ? R(i == j) : at.fisher[i][j];
            if (i == j && !fixed[i]) a += damping * at.fisher[i][i] + R(1e-8);
            const R whole = a;
            for (int k = 0; k < j; ++k) a -= L[i][k] * L[j][k];
            L[i][j] = i == j ? std::sqrt(std::fmax(a, R(1e-12) * whole)) : a / L[j][j];
        }
        for (int k = 0; k < i; ++k) step[i] -= L[i][k] * step[k];
        step[i] /= L[i][i];
    }
    for (int i = free - 1; i >= 0; --i) {
        for (int k = i + 1; k < free; ++k) step[i] -= L[k][i] * step[k];
        step[i] /= L[i][i];
    }
}

// When to stop.
template <class R>
struct Patience {
    int steps;    // evaluations at most
    R tolerance;  // of -log L: a step that promises less is not taken
    R inside;     // -log L below which nothing more is wanted
    R outside;    // what the promise of a step, tenfold, must reach; else the search is given up
};

template <class R>
Patience<R> patience(int steps) {
    return Patience<R>{steps, R(1e-6), R(-kImpossible), R(kImpossible)};
}

// Moves a point that has been evaluated towards the minimum; returns the evaluations it took.
template <class R>
int score(const Target& target, const Model<R>& model, const Patience<R>& until, Point<R>& at) {
    const int free = free_of(model);
    R low[kFree], high[kFree];
    bounds(model, low, high);
    R damping = R(1e-3);
    int used = 0;
    while (used < until.steps && at.nll > until.inside && at.nll < R(kImpossible)) {
        bool fixed[kFree];
        R step[kFree];
        for (int i = 0; i < free; ++i) {
            fixed[i] = (at.theta[i] <= low[i] && at.gradient[i] > 0) ||
                       (at.theta[i] >= high[i] && at.gradient[i] < 0);
        }
        damped_step(at, fixed, free, damping, step);
        // Far steps leave what the slopes know about: the order moves by half, a logit or logarithm by 3.
        R shorter = 1;
        for (int i = 0; i < free; ++i) {
            const bool order = i == 0 && model.family == kFractional && model.hold != kHoldOrder;
            shorter = std::fmin(shorter, (order ? R(0.3) : R(1)) / std::fmax(std::fabs(step[i]), R(1e-30)));
        }
        Point<R> next;
        R promise = 0;
        for (int i = 0; i < free; ++i) {
            next.theta[i] = std::fmin(std::fmax(at.theta[i] + shorter * step[i], low[i]), high[i]);
            step[i] = next.theta[i] - at.theta[i];
        }
        for (int i = 0; i < free; ++i) {
            promise -= step[i] * at.gradient[i];
            for (int j = 0; j < free; ++j) promise -= R(0.5) * step[i] * at.fisher[i][j] * step[j];
        }
        if (!(promise > until.tolerance) && damping <= R(1e-3)) break;
        if (at.nll - 10 * promise > until.outside) break;
        evaluate(target, model, next);
        ++used;
        if (next.nll < at.nll) {
            at = next;
            damping = std::fmax(damping * R(0.2), R(1e-7));
        } else {
            damping = std::fmax(damping, R(1e-3)) * 8;
            if (damping > R(1e6)) break;
        }
    }
    return used;
}

}  // namespace whittle
}  // namespace fltea
