// Whittle fits of several spectra with the same bins: a grid of starts, and scoring from the best of them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "whittle_target.hpp"

namespace fltea {
namespace whittle {

// Bins and the spectra over them, padded (whittle_kernel.hpp).
class Spectra {
  public:
    // λ and counts of `bins` bins, and `series` rows of powers.
    Spectra(const double* lam, const double* counts, const double* power, std::size_t bins,
            std::size_t series)
        : bins_(), series_(series), size_((bins + kPadding - 1) / kPadding * kPadding) {
        storage_.assign(10 * size_, 0.0);
        double* column[10];
        for (std::size_t i = 0; i < 10; ++i) column[i] = storage_.data() + i * size_;
        for (std::size_t i = 0; i < size_; ++i) {
            const double l = lam[std::min(i, bins - 1)], half = 2 * std::sin(l / 2);
            const double values[] = {i < bins ? counts[i] : 0.0,
                                     std::log(half),
                                     (3.141592653589793 - l) / 2,
                                     l,
                                     std::cos(l),
                                     std::sin(l),
                                     std::cos(2 * l),
                                     std::sin(2 * l),
                                     half * half};
            for (std::size_t k = 0; k < 9; ++k) column[k][i] = values[k];
            ordinates_ += values[0];
        }
        bins_ = Bins{size_,     column[0], column[1], column[2], column[3],
                     column[4], column[5], column[6], column[7], column[8]};
        power_.assign(series * size_, 0.0);
        for (std::size_t s = 0; s < series; ++s)
            std::copy(power + s * bins, power + (s + 1) * bins, power_.data() + s * size_);
    }
    Spectra(const Spectra&) = delete;
    Spectra& operator=(const Spectra&) = delete;

    Target target(const Kernel& kernel, std::size_t series) const {
        return Target{&kernel, &bins_, power_.data() + series * size_, ordinates_};
    }
    double mean_power(std::size_t series) const {
        double sum = 0;
        for (std::size_t i = 0; i < size_; ++i) sum += power_[series * size_ + i] * bins_.counts[i];
        return sum / ordinates_;
    }
    const Bins& bins() const { return bins_; }
    const double* power() const { return power_.data(); }
    std::size_t series() const { return series_; }
    double ordinates() const { return ordinates_; }

  private:
    std::vector<double> storage_, power_;
    Bins bins_;
    std::size_t series_, size_;
    double ordinates_ = 0;
};

// -log L of every series for one spectrum of the best scale after another; quickest if many follow each other
// that differ in their variances only.
class Ranking {
  public:
    Ranking(const Kernel& kernel, const Spectra& spectra)
        : kernel_(kernel),
          spectra_(spectra),
          parts_(kMostParts * spectra.bins().size),
          ratio_(spectra.series()) {}

    void rank(Family family, const Natural<double>& at, double* nll, std::size_t stride) {
        const double log_spectrum = sums(family, at), m = spectra_.ordinates();
        for (std::size_t s = 0; s < spectra_.series(); ++s)
            nll[s * stride] = log_spectrum + m * std::log(ratio_[s] / m) + m;
    }

    // Σ c log S; ratio(series) is Σ c I/S.
    double sums(Family family, const Natural<double>& at) {
        const bool same =
            any_ && family == family_ && std::equal(at.shape, at.shape + Room<double>::kShapes, last_.shape);
        any_ = true;
        family_ = family;
        last_ = at;
        return kernel_.ratios(family, spectra_.bins(), spectra_.power(), spectra_.series(), at, same,
                              parts_.data(), ratio_.data());
    }
    double ratio(std::size_t series) const { return ratio_[series]; }

  private:
    const Kernel& kernel_;
    const Spectra& spectra_;
    std::vector<double> parts_, ratio_;
    bool any_ = false;
    Family family_ = kWhite;
    Natural<double> last_ = Natural<double>();
};

// A grid: points (size, free of the model), and the group of each, 0 <= group < groups.
struct Grid {
    const double* points;
    const std::int64_t* group;
    std::size_t size, groups;
};

// For each series the best point of each of the `kept` best groups, best first: (series, kept) numbers of
// points.
inline std::vector<std::size_t> best_starts(const Kernel& kernel, const Spectra& spectra,
                                            const Model<double>& model, const Grid& grid, std::size_t kept) {
    const std::size_t series = spectra.series(), free = static_cast<std::size_t>(free_of(model));
    std::vector<double> nll(series * grid.size, kImpossible);
    Ranking ranking(kernel, spectra);
    for (std::size_t i = 0; i < grid.size; ++i) {
        Mapped<double> at;
        if (map(model, grid.points + i * free, at))
            ranking.rank(model.family, at.natural, &nll[i], grid.size);
    }
    std::vector<std::size_t> found;
    std::vector<std::size_t> best(grid.groups), order(grid.groups);
    for (std::size_t s = 0; s < series; ++s) {
        const double* const mine = &nll[s * grid.size];
        std::fill(best.begin(), best.end(), grid.size);
        for (std::size_t i = 0; i < grid.size; ++i) {
            std::size_t& leader = best[static_cast<std::size_t>(grid.group[i])];
            if (leader == grid.size || mine[i] < mine[leader]) leader = i;
        }
        order = best;
        order.erase(std::remove(order.begin(), order.end(), grid.size), order.end());
        std::stable_sort(order.begin(), order.end(),
                         [mine](std::size_t a, std::size_t b) { return mine[a] < mine[b]; });
        for (std::size_t k = 0; k < kept; ++k) found.push_back(order[std::min(k, order.size() - 1)]);
    }
    return found;
}

// Scores from a start and keeps the end if it is the best so far.
inline void try_start(const Target& target, const Model<double>& model, const double* theta, int steps,
                      Point<double>& best) {
    Point<double> point;
    std::copy(theta, theta + free_of(model), point.theta);
    canonical(model, point.theta);
    evaluate(target, model, point);
    score(target, model, patience<double>(steps), point);
    if (point.nll < best.nll) best = point;
}

}  // namespace whittle
}  // namespace fltea
