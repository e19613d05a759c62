// Ends of an interval by profile likelihood: where the best spectrum that has a value is worse than the best
// of all by no more than the critical value of 2 log L (spectrum/profile.py says for which values). Where
// that spectrum has no white noise, R is at its bound, and another critical value holds.
//
// The likelihood is looked at 1/2, 1/4, ... of the possible range away from the best value on both sides, so
// that a second maximum far away is seen; the interval's ends are beyond the outermost values inside. A value
// is outside only if neither the search from its neighbour nor that from a grid leads inside. Of an axis that
// is fitted again and again only the surroundings of the last ends are looked at, most times.
#pragma once

#include "whittle_held.hpp"

namespace fltea {
namespace whittle {

struct Ends {
    double low, high;
};

const double kNoWhite = 1e-3;  // R over s2: less is none

const int kHalvings = 7;
const int kMostValues = 2 * (kHalvings + 1) + 3;

class Profile {
  public:
    // `best` as the fit of the whole model has found it, of coordinates and -log L; the one series of
    // `spectra`.
    Profile(const Kernel& kernel, const Spectra& spectra, const double* best, double scale, double nll,
            double h)
        : fits_(kernel, spectra, h), nll_(nll), best_() {
        const Model<double> whole = {kFractional, 2.0, kNothing, 0, 0, 0};
        Point<double> point = Point<double>();
        std::copy(best, best + kNumbersFree, point.theta);
        canonical(whole, point.theta);
        point.scale = scale;
        best_ = fits_.numbers(whole, point);
    }
    Profile(const Profile&) = delete;
    Profile& operator=(const Profile&) = delete;

    // Of `count` numbers. What is found inside for one is inside for the others too: where that is farther
    // out than their own search has come they are searched once more.
    //
    // near: the ends of the same numbers a little earlier, or null. Where those of now are near them they are
    // found without looking at all that is possible.
    void ends(const Profiled* what, std::size_t count, Ends* found, const Ends* near = nullptr) {
        std::vector<Scan> scans(count);
        known_.assign(count, Known{best_, best_});
        what_ = what;
        for (std::size_t i = 0; i < count; ++i) {
            if (near != nullptr && nearby(what[i], near[i], found[i])) continue;
            scan(what[i], scans[i]);
            found[i] = ends(what[i], scans[i]);
        }
        for (std::size_t i = 0; i < count; ++i) {
            const double margin = 0.02 * (found[i].high - found[i].low);
            if (fits_.value(what[i], known_[i].low) < found[i].low - margin ||
                fits_.value(what[i], known_[i].high) > found[i].high + margin) {
                if (scans[i].count == 0) scan(what[i], scans[i]);
                found[i] = ends(what[i], scans[i]);
            }
        }
    }

  private:
    static const int kNumbersFree = 3;

    // What the likelihood was at the values that were looked at, of which first to last are inside.
    struct Scan {
        double values[kMostValues];
        Point<double> points[kMostValues];
        int count = 0, first, last;
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
        out.points[here] = fits_.from(what, out.values[here], best_);
        fits_.search(fits_.model(what, out.values[here]), until(), out.points[here]);
        for (int i = here - 1; i >= 0; --i)
            if (look(what, out.values[i], out.points[i + 1], out.points[i])) out.first = i;
        for (int i = here + 1; i < out.count; ++i)
            if (look(what, out.values[i], out.points[i - 1], out.points[i])) out.last = i;
    }

    // False if the ends are not both near those before.
    bool nearby(const Profiled& what, const Ends& before, Ends& found) {
        if (!(before.low <= what.here && what.here <= before.high)) return false;
        const double margin = kNearby * (before.high - before.low);
        return near_end(what, before.low, -margin, what.low, found.low) &&
               near_end(what, before.high, margin, what.high, found.high);
    }

    // The end about `before`, towards `edge`, the end of what is possible; false if it is not there.
    bool near_end(const Profiled& what, double before, double margin, double edge, double& found) {
        const double sign = margin < 0 ? -1 : 1;
        Bracket bracket = Bracket();
        const bool at_edge = (edge - before - margin) * sign <= 0;
        bracket.inner = at_edge ? edge : before - margin;
        if ((bracket.inner - what.here) * sign <= 0) return false;
        bracket.in = fits_.from(what, bracket.inner, best_);
        fits_.search(fits_.model(what, bracket.inner), until(), bracket.in);
        if (!inside(what, fits_.model(what, bracket.inner), bracket.in)) return false;
        if (at_edge) {
            found = edge;
            return true;
        }
        bracket.outer = before + margin;
        if (look(what, bracket.outer, bracket.in, bracket.out)) return false;
        found = crossing(what, bracket);
        return true;
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
        const double farther = fits_.value(what, known);
        if ((farther - inner) * step > 1e-9) {
            inner = std::min(std::max(farther, what.low), what.high);
            in = fits_.from(what, inner, known);
            while (at != last && (scan.values[at + step] - inner) * step <= 0) at += step;
        }
        for (; at != last; at += step) {
            Bracket bracket = {inner, scan.values[at + step], in, scan.points[at + step]};
            if (!finished(what, bracket.outer, bracket.out)) return crossing(what, bracket);
            inner = bracket.outer;
            in = bracket.out;
        }
        return inner;
    }

    // The search at a value that was given up once it was known to be inside, or seemed to be outside.
    // Returns whether it is inside.
    bool finished(const Profiled& what, double value, Point<double>& point) {
        const Model<double> held = fits_.model(what, value);
        if (point.nll < kImpossible) fits_.score_on(held, until(), point);
        return inside(what, held, point);
    }

    // Every spectrum that is met and is inside for a number is remembered, if that is farther out than
    // before.
    bool inside(const Profiled& what, const Model<double>& held, const Point<double>& point) {
        const Numbers now = fits_.numbers(held, point);
        for (std::size_t i = 0; i < known_.size(); ++i) {
            if (!within(what_[i], now, point)) continue;
            const double here = fits_.value(what_[i], now);
            if (here < fits_.value(what_[i], known_[i].low)) known_[i].low = now;
            if (here > fits_.value(what_[i], known_[i].high)) known_[i].high = now;
        }
        return within(what, now, point);
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

    Patience<double> until() const {
        Patience<double> all = patience<double>(40);
        all.tolerance = 1e-3;
        return all;
    }
    // Enough to know whether a value is inside.
    Patience<double> brief(const Profiled& what) const {
        Patience<double> until = Profile::until();
        until.inside = nll_ + std::min(what.critical.inside, what.critical.at_bound) / 2;
        until.outside = nll_ + std::max(what.critical.inside, what.critical.at_bound) / 2;
        return until;
    }

    bool within(const Profiled& what, const Numbers& now, const Point<double>& point) const {
        return point.nll <= nll_ + critical(what, now) / 2;
    }

    static double critical(const Profiled& what, const Numbers& now) {
        const bool at_bound = what.hold != kHoldNoise && now.log_noise - now.log_state < std::log(kNoWhite);
        return at_bound ? what.critical.at_bound : what.critical.inside;
    }

    // Whether a value is inside; `point` is then any spectrum that shows it, else about the best one.
    bool look(const Profiled& what, double value, const Point<double>& neighbour, Point<double>& point) {
        const Model<double> held = fits_.model(what, value);
        point = neighbour;
        fits_.search(held, brief(what), point);
        if (inside(what, held, point)) return true;
        const Point<double> other = fits_.from_grid(held, brief(what), 1);
        if (other.nll < point.nll) point = other;
        return inside(what, held, point);
    }

    // The signed root of the deviance above the critical one: nearly straight.
    double excess(const Profiled& what, const Model<double>& held, const Point<double>& point) const {
        return std::sqrt(std::min(std::max(2 * (point.nll - nll_), 0.0), 1e8)) -
               std::sqrt(critical(what, fits_.numbers(held, point)));
    }
    double excess(const Profiled& what, double value, const Point<double>& point) const {
        return excess(what, fits_.model(what, value), point);
    }

    // A value inside and one outside, and the best spectra there.
    struct Bracket {
        double inner, outer;
        Point<double> in, out;
    };

    double crossing(const Profiled& what, Bracket bracket) {
        // The best value itself may be outside, where it had to be moved to what is possible.
        if (!finished(what, bracket.inner, bracket.in)) return bracket.inner;
        const Bracket all = bracket;
        for (int turn = 0; turn < kTurns; ++turn) {
            const bool found = narrow(what, bracket);
            // It is an end only if the likelihood does not jump there, as it does where a search has lost its
            // minimum to another, and if the grid does not lead inside.
            const Model<double> held = fits_.model(what, bracket.outer);
            const Point<double> other = fits_.from_grid(held, brief(what), 2);
            if (inside(what, held, other)) {
                bracket = Bracket{bracket.outer, all.outer, other, all.out};
            } else if (found) {
                break;
            } else {
                bracket.outer = all.outer;
                bracket.out = all.out;
            }
            walk(what, bracket);
        }
        const double a = excess(what, bracket.inner, bracket.in);
        const double b = excess(what, bracket.outer, bracket.out);
        const double share = a < 0 && b > 0 ? a / (a - b) : 0;
        return bracket.inner + share * (bracket.outer - bracket.inner);
    }

    // Draws the bracket together around the end, by the regula falsi in the Illinois way: neither side stays
    // for long. False if the end cannot be met.
    bool narrow(const Profiled& what, Bracket& bracket) {
        int side = 0;
        double a = excess(what, bracket.inner, bracket.in), b = excess(what, bracket.outer, bracket.out);
        for (int i = 0; i < kSteps; ++i) {
            const double share = std::min(std::max(-a / (b - a), 0.02), 0.98);
            const double value = bracket.inner + share * (bracket.outer - bracket.inner);
            const Model<double> held = fits_.model(what, value);
            Point<double> point = bracket.in;
            const bool between = close(bracket.in, bracket.out);
            if (between)
                for (int k = 0; k < kNumbersFree; ++k)
                    point.theta[k] += share * (bracket.out.theta[k] - bracket.in.theta[k]);
            fits_.search(held, until(), point);
            if (between &&
                excess(what, held, point) > kNear) {  // which may be another minimum than that inside
                Point<double> other = bracket.in;
                fits_.search(held, until(), other);
                if (other.nll < point.nll) point = other;
            }
            const double found = excess(what, held, point);
            if (inside(what, held, point)) {
                bracket.inner = value;
                bracket.in = point;
                a = found;
                if (side == -1) b /= 2;
                side = -1;
            } else {
                bracket.outer = value;
                bracket.out = point;
                b = found;
                if (side == 1) a /= 2;
                side = 1;
            }
            if (std::fabs(found) < kNear) return true;
        }
        return false;
    }

    // From the value inside outwards, so slowly that the search keeps its minimum, to the first outside.
    void walk(const Profiled& what, Bracket& bracket) {
        const double whole = bracket.outer - bracket.inner;
        for (double step = whole / 128; std::fabs(bracket.outer - bracket.inner) > std::fabs(step);
             step *= 2) {
            const double value = bracket.inner + step;
            Point<double> point = bracket.in;
            const Model<double> held = fits_.model(what, value);
            fits_.search(held, until(), point);
            if (!inside(what, held, point)) {
                bracket.outer = value;
                bracket.out = point;
                return;
            }
            bracket.inner = value;
            bracket.in = point;
        }
    }

    static bool close(const Point<double>& one, const Point<double>& other) {
        double farthest = 0;
        for (int k = 0; k < kNumbersFree; ++k)
            farthest = std::max(farthest, std::fabs(one.theta[k] - other.theta[k]));
        return other.nll < kImpossible && farthest < 1;
    }

    static const int kTurns = 3, kSteps = 12;
    static constexpr double kNear = 0.02;
    // Share of the interval's width within which an end is looked for about the one before.
    static constexpr double kNearby = 0.1;

    HeldFits fits_;
    double nll_;
    Numbers best_;
    const Profiled* what_ = nullptr;
    std::vector<Known> known_;
};

}  // namespace whittle
}  // namespace fltea
