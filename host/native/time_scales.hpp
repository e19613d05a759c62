// Computes the Haar wavelet variances in constant memory. They say how much the mean of 1, 2, 4 … consecutive
// values differs from the mean of equally many values before.
#pragma once

#include <cstdint>

namespace fltea {

// At scale s, the means of two neighbouring groups of 2^s values are compared; the pairs of groups do not
// overlap. A pair contributes 2^s d²/2, where d is the difference of the two means. For independent values,
// the mean of these contributions is the variance of the values at every scale (Percival and Walden, Wavelet
// Methods for Time Series Analysis, 2000). The more values are added, the more precise is the result at every
// scale, also at the shortest. The cells of time_cells.hpp, in contrast, become wider, and then say nothing
// about short times.
template <int kScales>
class TimeScales {
  public:
    // `span`: After this number of values, all pairs of groups so far become old pairs. After another `span`
    // values, the old pairs are forgotten. If `span` is 0, nothing is forgotten.
    explicit TimeScales(std::uint32_t span = 0) : span_(span), waiting_(0) { clear(); }

    static int size() { return kScales; }
    double pairs(int s) const { return double(pairs_[s]) + double(old_pairs_[s]); }
    // Mean of 2^s d²/2 over all pairs of groups at scale s, where d is the difference of the two groups'
    // means; 0 if there is no pair.
    double variance(int s) const {
        const double n = pairs(s);
        return n > 0 ? (sum_[s] + double(old_sum_[s])) / n : 0;
    }

    void add(float figure) {
        if (span_ > 0 && 2 * std::uint64_t(pairs_[0]) >= span_) {
            for (int s = 0; s < kScales; ++s) {
                old_sum_[s] = float(sum_[s]);
                old_pairs_[s] = pairs_[s];
                sum_[s] = 0;
                pairs_[s] = 0;
            }
            waiting_ = 0;
        }
        add(0, figure);
    }

    // Merges the sums of a later part of the record into these.
    void merge(const TimeScales& other) {
        for (int s = 0; s < kScales; ++s) {
            sum_[s] += other.sum_[s];
            pairs_[s] += other.pairs_[s];
            old_sum_[s] += other.old_sum_[s];
            old_pairs_[s] += other.old_pairs_[s];
        }
        // At some scales, `other` has the mean of a first group, whose second group was not complete at the
        // end of `other`. These means are added here, so that the pairs can still become complete. The
        // longest group comes first, because it is the earliest.
        for (int s = kScales - 1; s >= 0; --s) {
            if (other.waits(s)) add(s, other.first_[s]);
        }
    }

    // Saves or loads all numbers in the same way as TimeCells::visit.
    template <typename Io>
    void visit(Io& io) {
        io.number(waiting_, 0, (1u << kScales) - 1);
        for (int s = 0; s < kScales && io.sound(); ++s) {
            io.real(first_[s], -2e3, 2e3);
            io.real(sum_[s], 0, 1e16);
            io.number(pairs_[s], 0, kMostPairs);
            io.real(old_sum_[s], 0, 1e16);
            io.number(old_pairs_[s], 0, kMostPairs);
        }
    }

  private:
    static constexpr std::uint32_t kMostPairs = 1u << 30;

    bool waits(int s) const { return (waiting_ >> s & 1u) != 0; }

    void add(int s, float mean) {
        for (; s < kScales; ++s) {
            waiting_ ^= 1u << s;
            if (waits(s)) {
                first_[s] = mean;
                return;
            }
            const double apart = double(mean) - double(first_[s]);
            sum_[s] += apart * apart / 2 * double(1u << s);
            if (pairs_[s] < kMostPairs) ++pairs_[s];
            mean = (mean + first_[s]) / 2;
        }
    }

    void clear() {
        for (int s = 0; s < kScales; ++s) {
            sum_[s] = 0;
            first_[s] = old_sum_[s] = 0;
            pairs_[s] = old_pairs_[s] = 0;
        }
    }

    double sum_[kScales];   // sum of 2^s d²/2 over the pairs (variance())
    float first_[kScales];  // mean of the first group of a pair whose second group is not complete yet
    std::uint32_t pairs_[kScales];
    float old_sum_[kScales];  // as sum_, but over the old pairs
    std::uint32_t old_pairs_[kScales];
    std::uint32_t span_;
    std::uint32_t waiting_;  // bit s: whether first_[s] waits for the second group of its pair
};

}  // namespace fltea
