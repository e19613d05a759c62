// Ends of an interval by profile likelihood: where the best spectrum that has a value is worse than the best
// of all by no more than the critical value of 2 log L (spectrum/profile.py says for which values).
//
// The likelihood is looked at 1/2, 1/4, ... of the possible range away from the best value on both sides, so
// that a second maximum far away is seen; the interval's ends are beyond the outermost values inside. A value
// is outside only if neither the search from its neighbour nor that from a grid leads inside.
#pragma once

#include "whittle_fit.hpp"

namespace fltea {
namespace whittle {

// What is profiled: a number t of the model, or -t of g and f, as it is or in its logarithm.
struct Profiled {
    Hold hold;
    bool logarithm;
    double here;       // the best value, in the unit in which is searched
    double low, high;  // what is possible, in the same
};

struct Ends {
    double low, high;
};

// A spectrum of the fractional model.
struct Numbers {
    double alpha, g, log_state, log_noise;
};

const int kHalvings = 7;
const int kMostValues = 2 * (kHalvings + 1) + 3;

class Profile {
  public:
    // `best` as the fit of the whole model has found it, of coordinates and -log L; the one series of
    // `spectra`.
    Profile(const Kernel& kernel, const Spectra& spectra, const double* best, double scale, double nll,
            double critical, double h)
        : kernel_(kernel),
          spectra_(spectra),
          target_(spectra.target(kernel, 0)),
          ranking_(kernel, spectra),
          log_power_(std::log(spectra.mean_power(0))),
          log_h_(std::log(h)),
          nll_(nll),
          critical_(critical),
          best_() {
        Model<double> whole = {kFractional, 2.0, kNothing, 0, 0, 0};
        Point<double> point = Point<double>();
        std::copy(best, best + kNumbersFree, point.theta);
        canonical(whole, point.theta);
        point.scale = scale;
        best_ = numbers(whole, point);
    }
    Profile(const Profile&) = delete;
    Profile& operator=(const Profile&) = delete;

    // Of `count` numbers. What is found inside for one is inside for the others too: where that is farther
    // out than their own search has come they are searched once more.
    void ends(const Profiled* what, std::size_t count, Ends* found) {
        std::vector<Scan> scans(count);
        known_.assign(count, Known{best_, best_});
        what_ = what;
        for (std::size_t i = 0; i < count; ++i) {
            scan(what[i], scans[i]);
            found[i] = ends(what[i], scans[i]);
        }
        for (std::size_t i = 0; i < count; ++i) {
            const double margin = 0.02 * (found[i].high - found[i].low);
            if (value(what[i], known_[i].low) < found[i].low - margin ||
                value(what[i], known_[i].high) > found[i].high + margin)
                found[i] = ends(what[i], scans[i]);
        }
    }

  private:
    static const int kNumbersFree = 3;

    // What the likelihood was at the values that were looked at, of which first to last are inside.
    struct Scan {
        double values[kMostValues];
        Point<double> points[kMostValues];
        int count, first, last;
    };

    // Spectra inside with the lowest and the highest value.
    struct Known {
        Numbers low, high;
    };

    void scan(const Profiled& what, Scan& out) {
        out.count = scan_values(what, out.values);
        const int here =
            static_cast<int>(std::lower_bound(out.values, out.values + out.count, what.here) - out.values);
        out.first = out.last = here;
        out.points[here] = from(what, out.values[here], best_);
        search(model(what, out.values[here]), until(), out.points[here]);
        for (int i = here - 1; i >= 0; --i)
            if (look(what, out.values[i], out.points[i + 1], out.points[i])) out.first = i;
        for (int i = here + 1; i < out.count; ++i)
            if (look(what, out.values[i], out.points[i - 1], out.points[i])) out.last = i;
    }

    Ends ends(const Profiled& what, const Scan& scan) {
        const Known& known = known_[static_cast<std::size_t>(&what - what_)];
        return Ends{end(what, scan, scan.first, -1, known.low), end(what, scan, scan.last, 1, known.high)};
    }

    // From the outermost value inside, `at` or what is `known`, towards the next in the direction `step`.
    double end(const Profiled& what, const Scan& scan, int at, int step, const Numbers& known) {
        const int last = step < 0 ? 0 : scan.count - 1;
        double inner = scan.values[at];
        Point<double> in = scan.points[at];
        const double farther = value(what, known);
        if ((farther - inner) * step > 1e-9) {
            inner = std::min(std::max(farther, what.low), what.high);
            in = from(what, inner, known);
            while (at != last && (scan.values[at + step] - inner) * step <= 0) at += step;
        }
        if (at == last) return scan.values[last];
        return crossing(what, inner, in, scan.values[at + step], scan.points[at + step]);
    }

    Numbers numbers(const Model<double>& held, const Point<double>& point) const {
        Mapped<double> at;
        if (!map(held, point.theta, at)) return best_;
        return Numbers{at.natural.shape[0], at.natural.shape[1],
                       std::log(at.natural.variance[0] * point.scale),
                       std::log(at.natural.white * point.scale)};
    }

    // The number that is profiled, as it is searched for.
    double value(const Profiled& what, const Numbers& of) const {
        switch (what.hold) {
            case kHoldOrder:
                return of.alpha;
            case kHoldFeedback:
                return std::log(-of.g);
            case kHoldParameter:
                return std::log(-of.g) - of.alpha * log_h_;
            case kHoldWeight:
                return of.alpha + of.g;
            case kHoldState:
                return of.log_state;
            default:
                return of.log_noise;
        }
    }

    // Every spectrum inside that is met is remembered, if it has a number farther out than the others.
    bool inside(const Model<double>& held, const Point<double>& point) {
        if (!(point.nll <= limit())) return false;
        const Numbers now = numbers(held, point);
        for (std::size_t i = 0; i < known_.size(); ++i) {
            const double here = value(what_[i], now);
            if (here < value(what_[i], known_[i].low)) known_[i].low = now;
            if (here > value(what_[i], known_[i].high)) known_[i].high = now;
        }
        return true;
    }

    static int scan_values(const Profiled& what, double* values) {
        int count = 0;
        values[count++] = what.low;
        values[count++] = what.here;
        values[count++] = what.high;
        double step = what.high - what.low;
        for (int i = 0; i <= kHalvings; ++i, step /= 2) {
            values[count++] = std::max(what.here - step, what.low);
            values[count++] = std::min(what.here + step, what.high);
        }
        std::sort(values, values + count);
        return static_cast<int>(std::unique(values, values + count) - values);
    }

    Model<double> model(const Profiled& what, double value) const {
        const double t = what.logarithm ? std::exp(value) : value;
        const bool negative = what.hold == kHoldFeedback || what.hold == kHoldParameter;
        return Model<double>{kFractional, 2.0, what.hold, negative ? -t : t, log_h_, log_power_};
    }

    Patience<double> until() const {
        Patience<double> all = patience<double>(40);
        all.tolerance = 1e-4;
        return all;
    }
    double limit() const { return nll_ + critical_ / 2; }

    // A spectrum, moved as little as it must be to have the value.
    Point<double> from(const Profiled& what, double value, const Numbers& start) const {
        const Model<double> held = model(what, value);
        Point<double> point = Point<double>();
        const double weight = start.log_state - start.log_noise;
        const double share = std::min(std::max(-start.g / std::exp2(start.alpha), kSmallest), 1 - kSmallest);
        point.theta[0] = what.hold == kHoldOrder    ? logit(share)
                         : what.hold == kHoldWeight ? std::log(-start.g)
                                                    : start.alpha;
        point.theta[1] = scaled(held) ? weight : logit(share);
        point.theta[2] = what.hold == kHoldState ? start.log_noise : start.log_state;
        canonical(held, point.theta);
        evaluate(target_, held, point);
        return point;
    }

    // From point.theta to a minimum.
    void search(const Model<double>& held, const Patience<double>& until, Point<double>& point) const {
        canonical(held, point.theta);
        evaluate(target_, held, point);
        score(target_, held, until, point);
    }

    // Whether a value is inside; `point` is then any spectrum that shows it, else about the best one.
    bool look(const Profiled& what, double value, const Point<double>& neighbour, Point<double>& point) {
        const Model<double> held = model(what, value);
        Patience<double> brief = until();
        brief.inside = limit();
        point = neighbour;
        search(held, brief, point);
        if (inside(held, point)) return true;
        Point<double> other = from_grid(held);
        score(target_, held, brief, other);
        if (other.nll < point.nll) point = other;
        return inside(held, point);
    }

    // The best point of a grid.
    Point<double> from_grid(const Model<double>& held) {
        static const double kOrders[] = {0.05, 0.3, 0.6, 0.95, 1.3, 1.8};
        static const double kFeedbacks[] = {-9, -6, -4, -2, 0, 3};
        static const double kWeights[] = {-7, -3, -1, 1, 4};
        static const double kShares[] = {5e-4, 0.01, 0.06, 0.2, 0.45, 0.8};
        double low[kFree], high[kFree];
        bounds(held, low, high);
        const double least = std::exp(low[0]), most = std::exp(high[0]);  // of -g, if F is held
        const bool variance = !scaled(held);
        Point<double> best = Point<double>(), now = best;
        best.nll = kImpossible;
        for (int i = 0; i < 6; i += variance ? 2 : 1) {
            for (int j = 0; j < (variance ? 6 : 1); j += 2) {
                for (int k = 0; k < 5; ++k) {
                    now.theta[0] = held.hold == kHoldOrder    ? kFeedbacks[i]
                                   : held.hold == kHoldWeight ? std::log(least + kShares[i] * (most - least))
                                                              : kOrders[i];
                    now.theta[1] = variance ? kFeedbacks[j + 1] : kWeights[k];
                    now.theta[2] = variance ? log_power_ - 0.7 - 2.5 * (4 - k) : 0;
                    Mapped<double> at;
                    double nll;
                    if (!map(held, now.theta, at)) continue;
                    ranking_.rank(held.family, at.natural, !variance, &nll, 1);
                    now.nll = nll;
                    if (now.nll < best.nll) best = now;
                }
            }
        }
        if (best.nll < kImpossible) {
            canonical(held, best.theta);
            evaluate(target_, held, best);
        }
        return best;
    }

    // The signed root of the deviance above the critical one: nearly straight.
    double excess(const Point<double>& point) const {
        return std::sqrt(std::min(std::max(2 * (point.nll - nll_), 0.0), 1e8)) - std::sqrt(critical_);
    }

    // Between a value inside and one outside.
    double crossing(const Profiled& what, double inner, Point<double> in, double outer, Point<double> out) {
        score(target_, model(what, inner), until(), in);
        if (out.nll < kImpossible) score(target_, model(what, outer), until(), out);
        const double farthest = outer;
        const Point<double> beyond = out;
        for (int turn = 0; turn < kTurns; ++turn) {
            bool checked = false;
            double a = excess(in), b = excess(out);
            for (int i = 0; i < kSteps && !checked; ++i) {
                // The regula falsi, away from the ends; every third step halves.
                double share = i % 3 == 2 ? 0.5 : -a / (b - a);
                share = std::min(std::max(share, 0.02), 0.98);
                const double value = inner + share * (outer - inner);
                const Model<double> held = model(what, value);
                Point<double> point = in;
                const bool between = close(in, out);
                if (between)
                    for (int k = 0; k < kNumbersFree; ++k)
                        point.theta[k] += share * (out.theta[k] - in.theta[k]);
                search(held, until(), point);
                if (between && excess(point) > kNear) {  // which may be another minimum than that inside
                    Point<double> other = in;
                    search(held, until(), other);
                    if (other.nll < point.nll) point = other;
                }
                inside(held, point);
                const double found = excess(point);
                checked = std::fabs(found) < kNear;
                if (found <= 0) {
                    inner = value;
                    in = point;
                    a = found;
                } else {
                    outer = value;
                    out = point;
                    b = found;
                }
            }
            // It is an end only if the grid does not lead to something better there.
            const double end = inner + (b > a ? -a / (b - a) : 0.5) * (outer - inner);
            const Model<double> held = model(what, outer);
            Point<double> other = from_grid(held);
            score(target_, held, until(), other);
            if (!(excess(other) < -kNear) || outer == farthest) return end;
            inner = outer;
            in = other;
            outer = farthest;
            out = beyond;
        }
        return inner;
    }

    static bool close(const Point<double>& one, const Point<double>& other) {
        double farthest = 0;
        for (int k = 0; k < kNumbersFree; ++k)
            farthest = std::max(farthest, std::fabs(one.theta[k] - other.theta[k]));
        return other.nll < kImpossible && farthest < 1;
    }

    static const int kTurns = 3, kSteps = 12;
    static constexpr double kNear = 0.01;

    const Kernel& kernel_;
    const Spectra& spectra_;
    Target target_;
    Ranking ranking_;
    double log_power_, log_h_, nll_, critical_;
    Numbers best_;
    const Profiled* what_ = nullptr;
    std::vector<Known> known_;
};

}  // namespace whittle
}  // namespace fltea
