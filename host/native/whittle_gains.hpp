// The noise parts that a search may add to a noise model, and how much each of them would raise the
// likelihood (Rao's score).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "whittle_fit.hpp"

namespace fltea {
namespace noise_models {

// A part that may be added to a model. `shape` is the spectrum of the part for the parameters `eta`. For a
// filter, `shape` is the logarithm of the filter's gain.
struct Candidate {
    Term term;
    double eta[3];
    Numbers shape, inverse;  // `inverse`: 1 / gain of a filter; empty for parts that are no filters
    bool leaks;              // only for a filter: whether white noise is added to its output
};

inline Candidate candidate(const Bins& bins, const Term& term, double a, double b, double c) {
    const std::size_t stride = stride_of(bins.size());
    Candidate found{term, {a, b, c}, Numbers(bins.size()), {}, false};
    Numbers spare(3 * stride);
    double* slope[3] = {spare.data(), spare.data() + stride, spare.data() + 2 * stride};
    if (!bins.kernel->term(bins.columns(), term, found.eta, found.shape.data(), slope))
        std::fill(found.shape.begin(), found.shape.end(), 0.0);
    if (!filters(term.part)) return found;
    found.inverse.resize(bins.size());
    bins.kernel->inverted(bins.size(), found.shape.data(), found.inverse.data());
    return found;
}

// Returns the candidate for the same filter with white noise added after it, so that some power remains
// where the filter blocks. For example, a random walk in white noise has such a spectrum after it has passed
// the filter.
inline Candidate leaking(const Bins& bins, Candidate filter) {
    constexpr double kLeak = 0.2;
    for (std::size_t i = 0; i < bins.size(); ++i) {
        const double gain = 1 / filter.inverse[i] + kLeak;
        filter.inverse[i] = 1 / gain;
        filter.shape[i] = std::log(gain);
    }
    filter.leaks = true;
    return filter;
}

// `gain`: how much 2 log L rises if a candidate is added to a model. For noise, this is Rao's score, where
// all parameters of the model are free. For a filter, it is the larger of two figures: the rise of 2 log L by
// the whole filter (of_filter), and Rao's score for a weak form of the filter, at most kLocal. (If G is the
// filter's gain, the weak form has the gain G^ε with a small ε.) `log_power`: logarithm of the power of the
// noise with which 2 log L rises most; 0 for a filter.
struct Gain {
    double gain, log_power;
};

class Gains {
  public:
    Gains(const Bins& bins, const Terms& terms, const double* eta)
        : bins_(bins),
          free_(free_of(terms)),
          size_(bins.size()),
          stride_(stride_of(size_)),
          row_(size_),
          weighted_(size_),
          excess_(size_),
          ratio_(size_) {
        Spectrum here(bins);
        here.at(terms, eta);
        double information[kMostFree][kMostFree];
        here.derivatives(free_, slope_, information);
        for (int i = 0; i < free_; ++i) information[i][i] = information[i][i] * (1 + 1e-9) + 1e-9;
        sound_ = factor(free_, information);
        if (!sound_) return;
        substitute(free_, information, slope_, false);
        // The derivatives of the logarithm of the spectrum by the model's parameters are combined to rows
        // that are orthogonal to each other, so that of() can treat each row on its own. The value of a row
        // at a bin is multiplied by the bin's number of ordinates.
        normal_.resize(static_cast<std::size_t>(free_) * stride_);
        for (std::size_t i = 0; i < size_; ++i) {
            double column[kMostFree];
            for (int k = 0; k < free_; ++k) column[k] = here.slope(k)[i];
            substitute(free_, information, column, false);
            for (int k = 0; k < free_; ++k)
                normal_[static_cast<std::size_t>(k) * stride_ + i] = column[k] * bins.counts[i];
            over_.push_back(1 / here.total()[i]);
            passed_.push_back(here.gain()[i] / here.total()[i]);
            ratio_[i] = bins.counts[i] * bins.power[i] / here.total()[i];
            excess_[i] = ratio_[i] - bins.counts[i];
            before_ += ratio_[i];
        }
    }

    Gain of(const Candidate& one) {
        if (!sound_) return Gain{0, 0};
        const bool filter = filters(one.term.part);
        const double* shape = one.shape.data();
        if (!filter) {
            const Numbers& by = row_of(one.term.part).is(kBehind) ? over_ : passed_;
            bins_.kernel->times(size_, shape, by.data(), row_.data());
            shape = row_.data();
        }
        bins_.kernel->times(size_, bins_.counts.data(), shape, weighted_.data());
        const double* rows[kMostFree + 2] = {excess_.data(), weighted_.data()};
        for (int k = 0; k < free_; ++k) rows[k + 2] = normal_.data() + static_cast<std::size_t>(k) * stride_;
        double found[kMostFree + 2];
        bins_.kernel->dots(size_, shape, free_ + 2, rows, found);
        double slope = found[0], curvature = found[1];
        for (int k = 0; k < free_; ++k) {
            const double cross = found[k + 2];
            slope += cross * slope_[k];
            curvature -= cross * cross;
        }
        const double whole = filter ? of_filter(one) : 0;
        if (!(slope > 0 && curvature > 0)) return Gain{whole, 0};
        const double gain = slope * slope / curvature;
        if (filter) return Gain{std::fmax(whole, std::fmin(gain, kLocal)), 0};
        return Gain{gain, std::log(slope / curvature)};
    }

  private:
    static constexpr double kLocal =
        // Upper limit of Rao's score for a filter. The score is inaccurate, because adding a filter is a
        // large change.
        30;

    // Returns how much 2 log L rises if the whole filter is added, not only a weak form of it (Gain). The
    // power of the whole spectrum is fitted again; all other parameters stay unchanged.
    double of_filter(const Candidate& one) const {
        const double* const shape = one.shape.data();
        const double* const inverse = one.inverse.data();
        double counted, after;
        bins_.kernel->dots(size_, bins_.counts.data(), 1, &shape, &counted);
        bins_.kernel->dots(size_, ratio_.data(), 1, &inverse, &after);
        return 2 * (before_ - counted - bins_.ordinates * (std::log(after / bins_.ordinates) + 1));
    }

    const Bins& bins_;
    int free_;
    std::size_t size_;
    bool sound_ = false;
    std::size_t stride_;
    Numbers row_, weighted_, excess_, ratio_, normal_, over_, passed_;
    double before_ = 0;
    double slope_[kMostFree];
};

// Logit of the number of poles with which a search tries a high-pass. It stands for 1.4 poles.
constexpr double kNearlyOnePole = -4.0;

// The candidates for noise parts. Each of them has the power 1.
typedef std::vector<Candidate> Candidates;

// Makes all candidates for one noise part. Their parameters are those that the part's row in kTable
// (whittle_parts.hpp) tells a search to begin with (Starts).
class Trials {
  public:
    Trials(const Bins& bins, Candidates& into)
        : bins_(bins), into_(into), lowest_(std::log(bins.lowest)), top_(std::log(kPi)) {}

    void add(const Row& row) {
        const Starts& from = row.starts;
        switch (from.start) {
            case kNever:
                break;
            case kOnce:
                at(row, 0, 0, 0);
                break;
            case kListed:
                for (int k = 0; k < from.count; ++k)
                    filters(row.part) ? at(row, from.at[k], 0, 0) : at(row, 0, from.at[k], 0);
                break;
            case kCorners:
                corners(row);
                break;
            case kPeaks:
                peaks(row);
                break;
            case kLowPasses:
                for (double corner = 2 * lowest_ + 2; corner < 4.3; corner += 0.9)
                    for (const double poles : {-4.0, -2.6, -1.2, 0.5}) at(row, corner, poles, 0);
                break;
            case kHighPasses:
                for (double corner = 2 * lowest_ + 0.5; corner < kHighestHighPass; corner += 1.3) {
                    at(row, corner, kNearlyOnePole, 0);
                    into_.push_back(leaking(bins_, into_.back()));
                }
                break;
            case kNotches:
                for (double on = std::fmax(top_ - 3, lowest_ + 0.1); on < top_ - 0.02; on += 0.12)
                    for (const double width : {0.05, 0.2}) at(row, on, std::log(width), 0);
                break;
            case kMeans:
                for (const int m : {2, 3, 4, 5, 8, 10})
                    into_.push_back(candidate(bins_, Term{row.part, m}, 0, 0, 0));
                break;
            case kOrders:
                orders(row);
                break;
            case kArfimas:
                for (const double d : {0.25, 0.45, 0.7})
                    for (const double rate : {-3.0, -1.5, -0.3}) at(row, d, rate, 0);
                break;
        }
    }

  private:
    void at(const Row& row, double a, double b, double c) {
        into_.push_back(candidate(bins_, Term{row.part, 0}, a, b, c));
    }
    void corners(const Row& row) {
        const double range = top_ - lowest_;
        const int count = 1 + static_cast<int>(std::lround(4 * range / std::log(10.0)));
        for (int i = 1; i <= count; ++i) at(row, 0, lowest_ + range * i / count, 0);
    }
    void peaks(const Row& row) {
        const double widths[3][2] = {{0.05, 0.12}, {0.12, 0.25}, {0.35, 0.5}};
        for (const auto& width : widths)
            for (double on = lowest_ + 1; on < top_ - 0.02; on += width[1])
                at(row, 0, on, std::log(width[0]));
    }
    void orders(const Row& row) {
        for (const double alpha : {0.2, 0.35, 0.5, 0.65, 0.8, 0.95}) {
            const double most = std::exp(kLn2 * alpha);
            for (int i = 0; i < 6; ++i) {
                const double corner = std::exp(lowest_ + 0.5 + (top_ - lowest_ - 1) * (i - 1) / 4.0);
                const double share = std::fmin(std::pow(2 * std::sin(corner / 2), alpha) / most, 0.98);
                at(row, alpha, i ? std::log(share / (1 - share)) : -15.0, 0);
            }
        }
    }

    const Bins& bins_;
    Candidates& into_;
    double lowest_, top_;
};

inline Candidates trials(const Bins& bins, const std::vector<Part>& parts) {
    Candidates found;
    Trials of(bins, found);
    for (const Part part : parts) of.add(row_of(part));
    return found;
}

inline Candidates parts_to_add(const Bins& bins) { return trials(bins, parts_with(0, kFilter | kOrdered)); }

inline Candidates filters_to_add(const Bins& bins) { return trials(bins, parts_with(kFilter)); }

inline Candidates orders_to_add(const Bins& of) {
    Bins bins = of;
    bins.lowest_order = 0;
    bins.highest_order = kHighestOrder;
    return trials(bins, parts_with(kOrdered));
}

// Returns the candidates that the function `make` makes for these bins. Candidates depend on the frequencies
// of the bins, not on the power in the bins, so the axes of a sensor share them. There are two kinds of fits
// in turn: of the whole spectrum, and of the spectrum without the bins in which a disturbance was found. So
// the newest two sets of candidates are kept.
template <Candidates (*make)(const Bins&)>
std::shared_ptr<const Candidates> shared(const Bins& bins) {
    struct Made {
        const Kernel* kernel;
        Numbers lam, walk;
        std::shared_ptr<const Candidates> candidates;
    };
    static std::mutex lock;
    static std::array<Made, 2> newest = {};
    {
        const std::lock_guard<std::mutex> guard(lock);
        for (const Made& one : newest)
            if (one.kernel == bins.kernel && one.lam == bins.lam && one.walk == bins.walk)
                return one.candidates;
    }
    Made made{bins.kernel, bins.lam, bins.walk, std::make_shared<const Candidates>(make(bins))};
    const std::lock_guard<std::mutex> guard(lock);
    newest[1] = std::move(newest[0]);
    newest[0] = made;
    return made.candidates;
}

}  // namespace noise_models
}  // namespace fltea
