// Finds the ends of the confidence intervals of a model's parameters by profile likelihood
// (host/fltea/spectrum/intervals.py).
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "whittle_fit.hpp"

namespace fltea {
namespace noise_models {

// white noise is negligible if -log L rises by less than this when it is removed
constexpr double kNoWhite = 0.01;

// Returns -log L of a model without its white noise.
inline double without_white(Room& room, const Terms& terms, std::vector<double> eta) {
    eta[0] = std::log(room.bins.mean) - kSmallest;
    return room.here.at(terms, eta.data());
}

// Limits of the loss. The loss at a value of a parameter says how much worse the best fit with this value is
// than the best fit of all. It is the difference of their 2 log L. The parameter's interval ends where the
// loss is `usual`. But if the fit with this value has no white noise, the interval ends where the loss is
// `at_bound`.
struct Critical {
    // if `usual` and `at_bound` are equal, it does not matter whether a fit has white noise
    double usual, at_bound;
};

// Fits the model with parameter i held at its value in `eta`, writes the best parameters to `eta`, and
// returns the loss (Critical). If the fit has no white noise, the returned loss is scaled by usual /
// at_bound. So the interval always ends where the returned loss is `critical.usual`. `nll`: -log L of the
// best fit of all.
inline double loss_of(Room& room, const Terms& terms, std::vector<double>& eta, double nll, int i,
                      const Critical& critical, const Patience& patience) {
    const double found = score(room, terms, eta.data(), i, patience);
    const double loss = std::isfinite(found) ? 2 * (found - nll) : 1e6;
    const bool has_bound = critical.at_bound != critical.usual;
    const bool at_bound = has_bound && without_white(room, terms, eta) - found < kNoWhite;
    return at_bound ? loss * (critical.usual / critical.at_bound) : loss;
}

// A value of the parameter that was tried, and all parameters of the best fit with this value.
struct Tried {
    double value, excess;  // `excess`: the loss that loss_of() has returned
    std::vector<double> eta;
};

// Returns the standard deviation that parameter i would have if log L were a parabola. Writes to `by` how
// much the best values of the other parameters change when parameter i changes by 1.
inline double direction(const Bins& bins, const Terms& terms, const std::vector<double>& best, int i,
                        std::vector<double>& by) {
    const int free = free_of(terms);
    double gradient[kMostFree], information[kMostFree][kMostFree], row[kMostFree] = {};
    Spectrum here(bins);
    by.assign(best.size(), 0.0);
    if (!std::isfinite(here.at(terms, best.data()))) return 0;
    here.derivatives(free, gradient, information);
    for (int k = 0; k < free; ++k) information[k][k] = information[k][k] * (1 + 1e-9) + 1e-9;
    if (!factor(free, information)) return 0;
    row[i] = 1;
    substitute(free, information, row, true);
    for (int k = 0; k < free; ++k) by[static_cast<std::size_t>(k)] = row[k] / row[i];
    return std::sqrt(row[i]);
}

// accuracy of an end of an interval, as a fraction of its distance from the best value
constexpr double kNear = 3e-3;

// A fit begins with white noise that is weaker than the power at the highest frequencies. The logarithm of
// its power is lower than the logarithm of that power by kLittle.
constexpr double kLittle = 4;

// Limits a change of a parameter to ±1. For larger changes, the derivatives say too little about the fit.
inline double near(double step) { return std::fmin(std::fmax(step, -1.0), 1.0); }

// Returns the end of the interval of parameter i, or NaN if the loss (Critical) is still too small at
// `limit`, the farthest value that is tried.
//     `side`: -1 for the lower end, 1 for the upper end.
//     `end`: differences of all parameters at the end from the best parameters. The caller passes those of
//       an earlier call, or none. They are replaced by those at the end that is found, or by none.
inline double interval_end(const Bins& bins, const Terms& terms, const std::vector<double>& best, double nll,
                           int i, int side, double limit, double step, const Critical& critical,
                           const Patience& patience, std::vector<double>& end) {
    const std::size_t at = static_cast<std::size_t>(i);
    const double middle = best[at], root = std::sqrt(critical.usual);
    Room room(bins);
    Tried inside{middle, 0, best}, outside{limit, 0, {}};
    double trial;
    std::vector<double> eta = best;
    if (end.size() == best.size() && side * end[at] > 0 && side * (limit - middle - end[at]) > 0) {
        trial = middle + end[at];
        for (std::size_t k = 0; k < eta.size(); ++k) eta[k] += end[k];
    } else {
        std::vector<double> by;
        const double far = root * direction(bins, terms, best, i, by);
        const double first = std::fmin(std::fmax(far, step), 8 * step);
        trial = middle + side * std::fmin(first, side * (limit - middle));
        for (std::size_t k = 0; k < eta.size(); ++k) eta[k] += near(by[k] * (trial - middle));
    }
    end.clear();
    // Each fit begins with a small amount of white noise. If the variance R of the white noise were
    // negligible, the likelihood would have no slope in log R. The fit could then not find out that another
    // value of the parameter needs white noise.
    const double some_white = std::log(std::fmax(end_power(bins, true), 1e-9 * bins.mean)) - kLittle;
    for (int look = 0; look < 40; ++look) {
        if (i != 0) eta[0] = std::fmax(eta[0], some_white);
        eta[at] = trial;
        const double excess = loss_of(room, terms, eta, nll, i, critical, patience);
        const bool close = std::fabs(excess - critical.usual) < 0.02;
        if (!close && excess < critical.usual) {
            if (trial == limit) return std::numeric_limits<double>::quiet_NaN();
            inside = Tried{trial, excess, eta};
        } else {
            outside = Tried{trial, excess, eta};
        }
        if (close || (!outside.eta.empty() &&
                      std::fabs(outside.value - inside.value) < kNear * std::fabs(outside.value - middle)))
            break;
        // The loss is nearly a quadratic function of the distance from the best value, so its square root is
        // nearly linear.
        const double a = std::sqrt(std::fmax(inside.excess, 0.0));
        if (outside.eta.empty()) {
            const double wider = std::fmin(std::fmax(1.05 * root / std::fmax(a, 1e-3), 1.1), 2.6);
            trial = middle + wider * (inside.value - middle);
            if (side * (trial - limit) >= 0) trial = limit;
            eta = inside.eta;
            for (std::size_t k = 0; k < eta.size(); ++k) eta[k] += near((wider - 1) * (eta[k] - best[k]));
        } else {
            const double share = (root - a) / std::fmax(std::sqrt(outside.excess) - a, 1e-12);
            const double part = std::fmin(std::fmax(share, 0.1), 0.9);
            trial = inside.value + part * (outside.value - inside.value);
            eta = inside.eta;
            for (std::size_t k = 0; k < eta.size(); ++k) eta[k] += near(part * (outside.eta[k] - eta[k]));
        }
    }
    if (outside.eta.empty()) return std::numeric_limits<double>::quiet_NaN();
    end = outside.eta;
    for (std::size_t k = 0; k < end.size(); ++k) end[k] -= best[k];
    return outside.value;
}

}  // namespace noise_models
}  // namespace fltea
