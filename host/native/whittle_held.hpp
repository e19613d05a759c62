// The best spectra that have a given value of one of the fractional model's numbers: where a search for them
// may begin, and the search.
#pragma once

#include "whittle_fit.hpp"

namespace fltea {
namespace whittle {

// Of 2 log L below the best of all, up to which a value is inside: where R is more than 0, and where it is 0
// without being held.
struct Critical {
    double inside, at_bound;
};

// What is profiled: a number t of the model, or -t of g and f, as it is or in its logarithm.
struct Profiled {
    Hold hold;
    bool logarithm;
    double here;       // the best value, in the unit in which is searched
    double low, high;  // what is possible, in the same
    Critical critical;
};

// A spectrum of the fractional model.
struct Numbers {
    double alpha, g, log_state, log_noise;
};

class HeldFits {
  public:
    // Of the one series of `spectra`; h in s.
    HeldFits(const Kernel& kernel, const Spectra& spectra, double h)
        : target_(spectra.target(kernel, 0)),
          ranking_(kernel, spectra),
          log_power_(std::log(spectra.mean_power(0))),
          log_h_(std::log(h)) {}
    HeldFits(const HeldFits&) = delete;
    HeldFits& operator=(const HeldFits&) = delete;

    double log_h() const { return log_h_; }

    Model<double> model(const Profiled& what, double value) const {
        const double t = what.logarithm ? std::exp(value) : value;
        const bool negative = what.hold == kHoldFeedback || what.hold == kHoldParameter;
        return Model<double>{kFractional, 2.0, what.hold, negative ? -t : t, log_h_, log_power_};
    }

    Numbers numbers(const Model<double>& model, const Point<double>& point) const {
        Mapped<double> at;
        map(model, point.theta, at);
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

    void score_on(const Model<double>& held, const Patience<double>& until, Point<double>& point) const {
        score(target_, held, until, point);
    }

    // From the `most` best rows of a grid, the best point of each, until one leads inside; the best end.
    Point<double> from_grid(const Model<double>& held, const Patience<double>& until, int most) {
        Point<double> rows[kRows], best = Point<double>();
        for (Point<double>& row : rows) row.nll = kImpossible;
        if (scaled(held)) {
            grid_of_scale(held, rows);
        } else {
            grid_of_variances(held, rows);
        }
        std::sort(rows, rows + kRows,
                  [](const Point<double>& one, const Point<double>& other) { return one.nll < other.nll; });
        best.nll = kImpossible;
        for (int i = 0; i < most && rows[i].nll < kImpossible && best.nll > until.inside; ++i) {
            search(held, until, rows[i]);
            if (rows[i].nll < best.nll) best = rows[i];
        }
        return best;
    }

    static const int kRows = 6;  // orders, or feedbacks where the order is held

  private:
    struct OneSums {
        double log_spectrum, ratio;
    };

    void grid_of_scale(const Model<double>& held, Point<double>* rows) {
        static const double kShares[] = {5e-4, 0.01, 0.06, 0.2, 0.45, 0.8};
        double low[Room<double>::kFree], high[Room<double>::kFree];
        bounds(held, low, high);
        const double least = std::exp(low[0]), most = std::exp(high[0]);  // of -g, if F is held
        for (int i = 0; i < kRows; ++i) {
            for (int k = 0; k < kWeights; ++k) {
                Point<double> now = Point<double>();
                now.theta[0] = held.hold == kHoldOrder    ? feedback(i)
                               : held.hold == kHoldWeight ? std::log(least + kShares[i] * (most - least))
                                                          : order(i);
                now.theta[1] = weight(k);
                Mapped<double> at;
                if (!map(held, now.theta, at)) continue;
                ranking_.rank(held.family, at.natural, &now.nll, 1);
                if (now.nll < rows[i].nll) rows[i] = now;
            }
        }
    }

    // Here every value is had of the same spectra by their scale: Σ c log S and Σ c I/S are kept of each.
    void grid_of_variances(const Model<double>& held, Point<double>* rows) {
        if (table_.empty()) {
            Model<double> whole = {kFractional, 2.0, kNothing, 0, 0, 0};
            for (int i = 0; i < kOrders * kFeedbacks * kWeights; ++i) {
                const double theta[] = {order(i / kWeights / kFeedbacks), feedback(i / kWeights % kFeedbacks),
                                        weight(i % kWeights)};
                Mapped<double> at;
                map(whole, theta, at);
                const double log_spectrum = ranking_.sums(whole.family, at.natural);
                table_.push_back(OneSums{log_spectrum, ranking_.ratio(0)});
            }
        }
        for (int i = 0; i < kOrders * kFeedbacks * kWeights; ++i) {
            const Share<double> share(weight(i % kWeights));
            const double scale = held.held / (held.hold == kHoldState ? share.value : 1 - share.value);
            const OneSums& sums = table_[static_cast<std::size_t>(i)];
            const double nll = sums.log_spectrum + target_.ordinates * std::log(scale) + sums.ratio / scale;
            Point<double>& best = rows[i / kWeights / kFeedbacks];
            if (nll < best.nll) {
                best.nll = nll;
                best.theta[0] = order(i / kWeights / kFeedbacks);
                best.theta[1] = feedback(i / kWeights % kFeedbacks);
                best.theta[2] = std::log(scale - held.held);
            }
        }
    }

    enum { kOrders = kRows, kFeedbacks = kRows, kWeights = 5 };
    static double order(int i) {
        static const double orders[kOrders] = {0.05, 0.3, 0.6, 0.95, 1.3, 1.8};
        return orders[i];
    }
    static double feedback(int i) {
        static const double feedbacks[kFeedbacks] = {-9, -6, -4, -2, 0, 3};
        return feedbacks[i];
    }
    static double weight(int i) {
        static const double weights[kWeights] = {-7, -3, -1, 1, 4};
        return weights[i];
    }

    Target target_;
    Ranking ranking_;
    double log_power_, log_h_;
    std::vector<OneSums> table_;
};

}  // namespace whittle
}  // namespace fltea
