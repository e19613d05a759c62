// Ends of intervals of a sentence's parameters by profile likelihood (host/fltea/spectrum/intervals.py).
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "sentence_fit.hpp"

namespace fltea {
namespace sentence {

// The end of the interval of parameter i to one side (-1, 1): where the best fit that has the value is as far
// below the best of all as `critical` says, in 2 log L; of those without white noise, as `at_bound` says.
// NaN: the profile does not fall so far before `limit`.
struct Critical {
    double usual, at_bound;
    int white_over;  // the parameter that white noise is compared with, or -1
};

inline double interval_end(const Bins& bins, const Words& words, const std::vector<double>& best, double nll,
                           int i, int side, double limit, double step, const Critical& critical,
                           const Patience& patience) {
    const double at = best[static_cast<std::size_t>(i)];
    double inside = at, inside_excess = 0, outside = 0, outside_excess = 0;
    bool bracketed = false;
    std::vector<double> eta = best;
    for (int look = 0; look < 40; ++look) {
        double trial;
        if (!bracketed) {
            trial = inside + side * step;
            step *= 1.6;
            if (side * (trial - limit) >= 0) trial = limit;
        } else {
            // The excess is about quadratic, so its root is about straight.
            const double a = std::sqrt(std::fmax(inside_excess, 0.0)),
                         b = std::sqrt(std::fmax(outside_excess, 0.0));
            const double share = (std::sqrt(critical.usual) - a) / std::fmax(b - a, 1e-12);
            trial = inside + std::fmin(std::fmax(share, 0.1), 0.9) * (outside - inside);
        }
        std::vector<double> there = eta;
        there[static_cast<std::size_t>(i)] = trial;
        const double found = score(bins, words, there.data(), i, patience);
        double excess = std::isfinite(found) ? 2 * (found - nll) : 1e6;
        if (critical.white_over >= 0 && there[0] < there[static_cast<std::size_t>(critical.white_over)] - 6.9)
            excess *= critical.usual / critical.at_bound;
        if (std::fabs(excess - critical.usual) < 0.02) return trial;
        if (excess < critical.usual) {
            if (trial == limit) return std::numeric_limits<double>::quiet_NaN();
            inside = trial;
            inside_excess = excess;
            eta = there;
        } else {
            bracketed = true;
            outside = trial;
            outside_excess = excess;
        }
        if (bracketed && std::fabs(outside - inside) < 1e-4) break;
    }
    return bracketed ? outside : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace sentence
}  // namespace fltea
