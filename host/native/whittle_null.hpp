// The null test asks whether white noise describes the samples as well as two other models. The first is an
// order in white noise. The second is white noise that has passed a high-pass of one pole, and so lacks power
// at low frequencies. tools/gen_null_constants.py simulates the distribution of the likelihood ratios.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fitted_model.hpp"
#include "whittle_gains.hpp"

namespace fltea {
namespace noise_models {

// The fitted models that the null test compares: white noise, an order in white noise, and white noise that
// has passed a high-pass and so is missing at low frequencies (`missing`).
struct NullTest {
    FittedModel white, order, missing;
};

class NullFits {
  public:
    // number of free parameters of the model with an order in white noise
    static constexpr int kOrderFree = 4;

    NullFits(Bins& bins, Room& room)
        : bins_(bins), room_(room), power_(std::log(bins.mean)), lowest_(2 * std::log(bins.lowest)) {}

    NullTest from(const Candidates& filters, const Candidates& orders) {
        const FittedModel w = white();
        Gains gains(bins_, w.terms, w.eta.data());
        return {w, best_order(w, gains, orders), best_high_pass(w, gains, filters)};
    }

    // Repeats an earlier null test. The fits start from `last`, which has the parameters that the earlier
    // test found: first those of an order in white noise, then those of white noise after a high-pass.
    NullTest again(const std::vector<double>& last) {
        const auto second = last.begin() + kOrderFree;
        return {white(), order({last.begin(), second}), missing({second, last.end()})};
    }

    FittedModel white() { return fitted({Term{kWhite, 0}}, {power_}, -1); }
    FittedModel order(std::vector<double> eta) {
        bins_.lowest_order = 0;
        bins_.highest_order = 1;
        return fitted({Term{kWhite, 0}, Term{kOrder, 0}}, std::move(eta), -1);
    }
    FittedModel missing(std::vector<double> eta) {
        return fitted({Term{kWhite, 0}, Term{kHighPass, 0}}, std::move(eta), 2);
    }

  private:
    static constexpr double kConverged = 1e-3;  // a fit ends when a step lowers -log L by less than this
    static constexpr std::size_t kOrders = 5;   // number of starting points for the fit of the order

    FittedModel fitted(Terms terms, std::vector<double> eta, int held) {
        Patience patience;
        patience.converged = kConverged;
        FittedModel found{std::move(terms), std::move(eta), 0};
        found.nll = score(room_, found.terms, found.eta.data(), held, patience);
        return found;
    }

    static void keep(const FittedModel& one, FittedModel& into) {
        if (one.nll < into.nll) into = one;
    }

    FittedModel best_order(const FittedModel& white, Gains& gains, const Candidates& orders) {
        std::vector<std::pair<Gain, const Candidate*>> ranked;
        for (const Candidate& one : orders) {
            if (one.term.part != kOrder) continue;
            const Gain gain = gains.of(one);
            if (gain.gain > 1) ranked.push_back({gain, &one});
        }
        std::stable_sort(
            ranked.begin(), ranked.end(),
            [](const std::pair<Gain, const Candidate*>& a, const std::pair<Gain, const Candidate*>& b) {
                return a.first.gain > b.first.gain;
            });
        FittedModel found = order({white.eta[0], 0.5, 0.0, power_ - kSmallest});
        for (std::size_t i = 0; i < ranked.size() && i < kOrders; ++i) {
            const double* const eta = ranked[i].second->eta;
            keep(order({white.eta[0], eta[0], eta[1], ranked[i].first.log_power}), found);
        }
        return found;
    }

    // Fits white noise that has passed a high-pass, from the best starting point only. This is enough,
    // because the likelihood as a function of the corner frequency has a single maximum, apart from chance.
    FittedModel best_high_pass(const FittedModel& white, Gains& gains, const Candidates& filters) {
        double corner = lowest_, gained = 0;
        for (const Candidate& one : filters) {
            if (one.term.part != kHighPass || one.leaks) continue;
            const double gain = gains.of(one).gain;
            if (gain > gained) corner = one.eta[0], gained = gain;
        }
        return missing({white.eta[0], corner, -kLogitEnd});
    }

    Bins& bins_;
    Room& room_;
    double power_, lowest_;
};

inline NullTest null_test(Bins& bins, const std::vector<double>& last) {
    Room room(bins);
    NullFits fits(bins, room);
    if (!last.empty()) return fits.again(last);
    return fits.from(*shared<filters_to_add>(bins), *shared<orders_to_add>(bins));
}

}  // namespace noise_models
}  // namespace fltea
