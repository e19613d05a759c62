// Searches for the noise models that describe a spectrum best. Noise parts are added to a model as long as
// they raise 2 log L by more than the price of their parameters, a fixed amount for each. After that, parts
// that no longer raise it as much are removed. Three models are searched for in the same way. The first
// (`plain`) is the best model without an order at the price of the criterion BIC. The second (`rich`) is the
// best model without an order at a lower price, which is what a parameter gains by chance. The third
// (`ordered`) is the best model with an order. Which of these models is believed is decided elsewhere
// (host/fltea/spectrum/verdict.py).
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "whittle_null.hpp"

namespace fltea {
namespace noise_models {

struct Frontier {
    FittedModel white, null, plain, rich, pure,
        ordered;  // `null`: an order up to 1 in white noise, for the null test (NullTest)
    FittedModel
        // white noise that has passed a high-pass of one pole, the second model with which the null test
        // compares white noise
        missing;
};

class Search {
  public:
    // `apart`: the noise parts that are added only in an additional search (kApart), because they imitate
    // others.
    explicit Search(Bins& bins, std::vector<Part> apart = parts_with(kApart))
        : bins_(bins),
          bic_(std::log(bins.ordinates)),
          power_(std::log(bins.mean)),
          apart_(std::move(apart)) {}

    // Searches for all models, starting from white noise.
    Frontier whole() {
        parts_ = shared<parts_to_add>(bins_);
        filters_ = shared<filters_to_add>(bins_);
        orders_ = shared<orders_to_add>(bins_);
        Frontier f;
        const NullTest test = null_.from(*filters_, *orders_);
        f.white = test.white;
        f.null = test.order;
        f.missing = test.missing;
        f.plain = grown(f.white, bic_, Allowed());
        if (!apart_.empty()) {
            Allowed apart;
            apart.apart = true;
            keep(grown(f.white, bic_, apart), bic_, f.plain);
        }
        find_orders(f);
        if (f.ordered.known()) {
            // Perhaps another part describes the spectrum better than the order does. To find such a part,
            // the order is removed, and other parts are tried before the remaining ones are fitted again. If
            // these were fitted first, one of their filters could move to where the order was.
            const FittedModel rest = removed(f.ordered, orders());
            Gains gains(bins_, rest.terms, rest.eta.data());
            FittedModel other;
            for (const Ranked& one : best(gains, rest, *parts_, 2, 1, Allowed()))
                keep(with(rest, one), bic_, other);
            if (other.known()) keep(grown(other, bic_, Allowed()), bic_, f.plain);
            keep(grown(without(f.ordered, orders()), bic_, Allowed()), bic_, f.plain);
        }
        f.rich = grown(f.plain, kByChance, Allowed());
        return f;
    }

    // Fits the models of an earlier search, `last`, again to the present bins.
    Frontier again(const Frontier& last) {
        Frontier f;
        f.white = null_.white();
        f.null = null_.order(last.null.eta);
        f.missing = null_.missing(last.missing.eta);
        const auto refit = [&](const FittedModel& one) {
            return one.known() ? fitted(one.terms, one.eta) : one;
        };
        f.plain = refit(last.plain);
        f.rich = refit(last.rich);
        f.pure = refit(last.pure);
        f.ordered = last.ordered.same_terms(last.pure) ? f.pure : refit(last.ordered);
        return f;
    }

    FittedModel fitted(const Terms& terms, std::vector<double> eta, bool roughly = false) {
        Patience patience;
        patience.converged = roughly ? kTrial : kRough;
        patience.steps = roughly ? kTrialSteps : kSteps;
        bins_.lowest_order = kLeastOrder;
        bins_.highest_order = kMostOrder;
        FittedModel found{terms, std::move(eta), 0};
        found.nll = score(room_, found.terms, found.eta.data(), -1, patience);
        return found;
    }

  private:
    static constexpr double kByChance = 3.0;  // a needless parameter may raise 2 log L by this much by chance
    static constexpr double kRough = 1e-3;    // a rough fit ends when a step lowers -log L by less than this
    // a trial fit ends when a step lowers -log L by less than this; that is accurate enough to choose one of
    // several trial fits, which is then fitted again
    static constexpr double kTrial = 0.1;
    static constexpr int kSteps = 60, kTrialSteps = 12;
    static constexpr int kMostParameters = 20;
    // ARFIMA (an order without f) is chosen only if its 2 log L exceeds that of the fractional state by more
    // than this
    static constexpr double kAhead = 6;
    // A part stays in the model, and no trial fit without it is made, if it raises 2 log L by more than this
    // many times its price. The price of a part is what its parameters have to raise 2 log L by.
    static constexpr double kSure = 4;
    // a search begins fits with at least this much white noise: e^-kNothing of the mean power, which is
    // negligible
    static constexpr double kNothing = 12;

    struct Allowed {
        bool slow = true;  // whether parts with the trait kSlow may be added
        bool only_low_pass = false;
        bool apart = false;  // whether the parts in `apart_` may be added (kApart)
    };

    static std::vector<Part> orders() { return parts_with(kOrdered); }
    double cost(const FittedModel& s, double price) const {
        return s.known() ? 2 * s.nll + price * s.parameters() : std::numeric_limits<double>::infinity();
    }

    bool fits_in(const FittedModel& s, const Term& term, const Allowed& allowed) const {
        const Row& row = row_of(term.part);
        if (s.count(term.part) >= row.most || (row.is(kSlow) && !allowed.slow)) return false;
        if (!allowed.apart && std::find(apart_.begin(), apart_.end(), term.part) != apart_.end())
            return false;
        if (row.is(kNoHighPass) && s.has(kHighPass)) return false;
        if (row.is(kBehind) && !s.filtered()) return false;
        return term.part != kLowPass || !s.has(kMean);
    }

    struct Ranked {
        const Candidate* candidate;
        Gain gain;
    };

    // Returns the best `count` candidates of `list`, but at most `alike` candidates of the same part.
    std::vector<Ranked> best(Gains& gains, const FittedModel& s, const std::vector<Candidate>& list,
                             int count, int alike, const Allowed& allowed) {
        std::vector<Ranked> all, found;
        for (const Candidate& one : list) {
            if (!fits_in(s, one.term, allowed)) continue;
            if (allowed.only_low_pass && one.term.part != kLowPass) continue;
            const Gain gain = gains.of(one);
            if (gain.gain > 1) all.push_back({&one, gain});
        }
        std::stable_sort(all.begin(), all.end(),
                         [](const Ranked& a, const Ranked& b) { return a.gain.gain > b.gain.gain; });
        for (const Ranked& one : all) {
            const auto same = [&](const Ranked& other) {
                return other.candidate->term.part == one.candidate->term.part;
            };
            const int most = one.candidate->term.part == kLowPass ? 2 : alike;
            if (std::count_if(found.begin(), found.end(), same) < most) found.push_back(one);
            const bool floor = std::any_of(found.begin(), found.end(), [](const Ranked& other) {
                return other.candidate->term.part == kFloor;
            });
            if (static_cast<int>(found.size()) == count + floor) break;
        }
        return found;
    }

    FittedModel with(const FittedModel& before, const Ranked& one) {
        const Candidate& candidate = *one.candidate;
        const FittedModel s =
            candidate.term.part == kHighPass ? removed(before, parts_with(kNoHighPass)) : before;
        Terms terms = s.terms;
        std::vector<double> eta = s.eta;
        eta[0] = std::fmax(eta[0], power_ - kNothing);
        terms.push_back(candidate.term);
        const std::size_t first = eta.size();
        eta.insert(eta.end(), candidate.eta, candidate.eta + free_of(candidate.term.part));
        const int power = power_of(candidate.term.part);
        if (power >= 0) eta[first + static_cast<std::size_t>(power)] = one.gain.log_power;
        const bool low = candidate.term.part == kLowPass, high = candidate.term.part == kHighPass;
        if ((low || high) && !s.has(kFloor)) {
            // White noise, for example from rounding, is added after the filter. Without this noise, a steep
            // filter leaves no power at some frequencies, and the model fits badly.
            terms.push_back(Term{kFloor, 0});
            eta.push_back(std::log(std::fmax(end_power(bins_, low), 1e-9 * bins_.mean) / 2));
            return taken_away(fitted(terms, eta, true), bic_, {kFloor});
        }
        return fitted(terms, eta, true);
    }

    FittedModel grown(FittedModel s, double price, const Allowed& allowed) {
        while (free_of(s.terms) < kMostParameters) {
            Gains gains(bins_, s.terms, s.eta.data());
            FittedModel next;
            for (const Ranked& one : best(gains, s, *parts_, 2, 1, allowed)) keep(with(s, one), price, next);
            for (const Ranked& one : best(gains, s, *filters_, 3, 1, allowed))
                keep(with(s, one), price, next);
            if (next.known()) next = fitted(next.terms, next.eta);
            if (!(cost(next, price) < cost(s, price))) break;
            s = next;
        }
        return taken_away(s, price, {});
    }

    // Replaces `into` by `one` if that is the better model with an order. An ARFIMA model has no f. It counts
    // as better than a fractional state D^α x = f x + ω only if it is better by more than kAhead.
    void keep_order(const FittedModel& one, FittedModel& into) const {
        const auto behind = [&](const FittedModel& s) {
            return cost(s, bic_) + (s.has(kArfima) ? kAhead : 0);
        };
        if (behind(one) < behind(into)) into = one;
    }

    void keep(const FittedModel& one, double price, FittedModel& into) const {
        if (cost(one, price) < cost(into, price)) into = one;
    }

    // Returns the model `s` without the parts that raise 2 log L by less than `price` times the number of
    // their parameters. `only`: the parts that may be removed. If `only` is empty, all parts except orders
    // may be removed.
    FittedModel taken_away(FittedModel s, double price, const std::vector<Part>& only) {
        for (;;) {
            FittedModel next;
            const std::vector<double> sure = certainty(s);
            for (std::size_t i = 1; i < s.terms.size(); ++i) {
                const Part part = s.terms[i].part;
                const bool named = std::find(only.begin(), only.end(), part) != only.end();
                if (only.empty() ? row_of(part).is(kOrdered) : !named) continue;
                if (part == kRise && !s.has(kQuantised)) keep(as_quantised(s, i), price, next);
                if (!filters(part) && sure[i] > kSure * price) continue;
                keep(without_term(s, i), price, next);
            }
            if (!(cost(next, price) <= cost(s, price))) return s;
            s = next;
        }
    }

    // Says how well the first parameter of each part is known: returns 1 / variance of the parameter, or 0 if
    // the part has none. The variance follows from the expected curvature of log L. If the parameter is the
    // log of the part's power, the result is the square of the ratio of the power to its standard deviation.
    std::vector<double> certainty(const FittedModel& s) const {
        std::vector<double> found(s.terms.size(), 0.0);
        const int free = free_of(s.terms);
        Spectrum here(bins_);
        here.at(s.terms, s.eta.data());
        double gradient[kMostFree], information[kMostFree][kMostFree];
        here.derivatives(free, gradient, information);
        for (int i = 0; i < free; ++i) information[i][i] = information[i][i] * (1 + 1e-9) + 1e-9;
        if (!factor(free, information)) return found;
        int at = 0;
        for (std::size_t i = 0; i < s.terms.size(); ++i) {
            const Part part = s.terms[i].part;
            double unit[kMostFree] = {0};
            if (free_of(part)) {
                unit[at] = 1;
                substitute(free, information, unit, true);
                found[i] = 1 / unit[at];
            }
            at += free_of(part);
        }
        return found;
    }

    FittedModel without_term(const FittedModel& s, std::size_t left_out) {
        FittedModel found = removed_term(s, left_out);
        found.eta[0] = std::fmax(found.eta[0], power_ - kNothing);
        return fitted(found.terms, found.eta);
    }

    // Returns the model without the part at index `left_out`. The parameters of all other parts stay as they
    // are.
    static FittedModel removed_term(const FittedModel& s, std::size_t left_out) {
        Terms terms;
        std::vector<double> eta;
        std::size_t at = 0;
        for (std::size_t i = 0; i < s.terms.size(); ++i) {
            const std::size_t count = static_cast<std::size_t>(free_of(s.terms[i].part));
            if (i != left_out) {
                terms.push_back(s.terms[i]);
                eta.insert(eta.end(), s.eta.begin() + static_cast<std::ptrdiff_t>(at),
                           s.eta.begin() + static_cast<std::ptrdiff_t>(at + count));
            }
            at += count;
        }
        return FittedModel{terms, eta, s.nll};
    }

    static FittedModel removed(FittedModel s, const std::vector<Part>& parts) {
        for (std::size_t i = s.terms.size(); i-- > 1;)
            if (std::find(parts.begin(), parts.end(), s.terms[i].part) != parts.end()) s = removed_term(s, i);
        return s;
    }

    // Returns the model with quantisation noise (kQuantised) in place of the part at index i, which is noise
    // whose power rises with the frequency (kRise). Quantisation noise has one parameter less.
    FittedModel as_quantised(const FittedModel& s, std::size_t i) {
        Terms terms = s.terms;
        std::vector<double> eta = s.eta;
        const Terms before(terms.begin(), terms.begin() + static_cast<std::ptrdiff_t>(i));
        const std::ptrdiff_t at = free_of(before);
        terms[i] = Term{kQuantised, 0};
        eta[static_cast<std::size_t>(at)] -= 2 * kLn2;
        eta.erase(eta.begin() + at + 1);
        return fitted(terms, eta);
    }

    FittedModel without(FittedModel s, const std::vector<Part>& parts) {
        for (std::size_t i = s.terms.size(); i-- > 1;)
            if (std::find(parts.begin(), parts.end(), s.terms[i].part) != parts.end()) s = without_term(s, i);
        return s;
    }

    FittedModel best_order(const std::vector<FittedModel>& bases) {
        FittedModel found;
        for (const FittedModel& base : bases) {
            Gains gains(bins_, base.terms, base.eta.data());
            for (const Ranked& one : best(gains, base, *orders_, 3, 2, Allowed()))
                keep_order(with(base, one), found);
        }
        return found;
    }

    // Finds two models with an order: `pure`, which has no relaxation and no random walk beside it, and
    // `ordered`, which may have any other parts.
    void find_orders(Frontier& f) {
        std::vector<FittedModel> bases = {f.white};
        Gains gains(bins_, f.white.terms, f.white.eta.data());
        Allowed low_pass;
        low_pass.only_low_pass = true;
        for (const Ranked& one : best(gains, f.white, *filters_, 1, 1, low_pass))
            bases.push_back(with(f.white, one));
        const FittedModel bare = removed(f.plain, parts_with(kSlow, kOrdered));
        if (!bare.same_terms(f.white)) bases.push_back(bare);
        f.pure = best_order(bases);
        if (!f.pure.known()) return;
        Allowed fast;
        fast.slow = false;
        f.pure = grown(f.pure, bic_, fast);
        f.ordered = grown(f.pure, bic_, Allowed());
        if (f.plain.same_terms(f.white) || f.plain.same_terms(bare)) return;
        FittedModel other = best_order({f.plain});
        if (other.known()) keep_order(grown(other, bic_, Allowed()), f.ordered);
    }

    Bins& bins_;
    Room room_{bins_};
    NullFits null_{bins_, room_};
    double bic_, power_;
    std::vector<Part> apart_;
    std::shared_ptr<const Candidates> parts_, filters_, orders_;

  public:
    // Range of orders that are reported. Noise of a lower order can hardly be distinguished from white noise.
    // Noise of a higher order can hardly be distinguished from a relaxation, and is reported as one.
    static constexpr double kLeastOrder = 0.15, kMostOrder = 0.85;
};

}  // namespace noise_models
}  // namespace fltea
