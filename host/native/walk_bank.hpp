// Estimates a bias while the noise is not known yet, with a bank of filters for many noise models
// (bank_members.hpp). Each filter is weighted by the likelihood that its model gives to the samples. The
// models state only ratios of variances; the scale of the noise is estimated from the samples.
#pragma once

#include <algorithm>
#include <vector>

#include "bank_members.hpp"

namespace fltea {
namespace track {

class WalkBank {
  public:
    enum { kFewest = 16 };

    // `ahead`: The bias is the expected mean over this number of future samples. If `ahead` is 0, it is the
    // bias of the newest sample.
    explicit WalkBank(std::int64_t ahead) : all_(&BankMembers::of(ahead)) {
        for (int i = 0; i < all_->count(); ++i) {
            members_.emplace_back(i);
            members_.back().filter.start(&all_->system(i), &all_->map(i), &all_->gains(i));
        }
    }

    // Whether there were enough samples to estimate the scale of the noise.
    bool knows() const { return count_ >= kFewest; }

    int count() const { return count_; }

    void predict(double y) {
        for (Member& one : members_) one.e = one.filter.innovation(y);
    }
    // Innovation of the filter with the likeliest model, and variance of this innovation.
    double innovation() const { return members_[best_].e; }
    double variance() const { return members_[best_].filter.S * members_[best_].scale(count_); }

    void go_on(bool take) {
        for (Member& one : members_) {
            if (take) one.add();
            one.filter.go_on(one.e, take);
        }
        if (!take) return;
        ++count_;
        if (count_ > kFewest && count_ % kWeighed != 0) return;
        weigh();
        if (count_ % kSorted != 0) return;
        const double most = members_[best_].unlikely + kHopeless;
        const auto lost = [most](const Member& one) { return one.unlikely > most; };
        members_.erase(std::remove_if(members_.begin(), members_.end(), lost), members_.end());
        weigh();
    }

    // Returns the weighted mean of the estimates of all filters, in the unit of the samples. The bank does
    // not distinguish state and bias, so it returns the bias for both.
    Known known() const {
        Known all = Known{0, 0, 0, 0, innovation(), variance()};
        double weights = 0, squares = 0;
        for (const Member& member : members_) {
            const double weight = member.weight;
            if (weight < kNegligible) continue;
            const Known one = member.filter.known(0);
            weights += weight;
            all.bias += weight * one.bias;
            squares += weight * (one.bias_variance * member.scale(count_) + one.bias * one.bias);
        }
        all.bias /= weights;
        const double variance = squares / weights - all.bias * all.bias;
        // If all samples are equal, the estimated scale of the noise is 0. This variance is then 0, too, but
        // rounding may make it slightly larger or smaller.
        all.bias_variance = variance > kNothing ? variance : 0;
        all.state = all.bias;
        all.state_variance = all.bias_variance;
        return all;
    }

    // 2 log L of the samples if the likeliest model describes them, up to a constant.
    double likelihood() const { return -2 * members_[best_].unlikely - count_; }

    template <typename Io>
    void visit(Io& io) {
        const BankMembers& all = *all_;
        std::size_t size = members_.size();
        io.number(size, 1, all.count());
        io.number(count_, 0, 1e9);
        if (!io.sound()) return;
        members_.resize(size);
        int least = 0;
        for (Member& one : members_) {
            io.number(one.index, least, all.count() - 1);
            if (!io.sound()) return;
            least = one.index + 1;
            io.real(one.logs, -1e300, 1e300);
            io.real(one.squares, 0, 1e300);
            io.real(one.e, -1e150, 1e150);
            one.filter.point_to(&all.system(one.index), &all.map(one.index));
            one.filter.visit(io);
            io.real(one.unlikely, -1e300, 1e300);
        }
        find_best();
    }

  private:
    enum { kWeighed = 8, kSorted = 32 };
    // A filter is dropped if its log likelihood is lower than that of the best filter by more than this.
    static constexpr double kHopeless = 15;
    static constexpr double kNegligible = 1e-4;

    struct Member {
        explicit Member(int which = 0) : index(which) {}
        int index;
        // two sums over the innovations, whose predicted variance is S: the sum of log S, and the sum of the
        // squared innovations divided by S
        double logs = 0, squares = 0;
        // `e`: innovation of the newest sample; `unlikely`: -log L of all samples
        double e = 0, unlikely = 0;
        double weight = 1;  // likelihood as a fraction of that of the best filter
        HeldLog log_S;
        Kalman<BankMembers::kMost> filter;

        void add() {
            logs += filter.log_S(log_S);
            squares += e * e / filter.S;
        }
        double scale(int count) const { return count > 0 && squares > 0 ? squares / count : 1e-300; }
    };

    void weigh() {
        for (Member& one : members_) one.unlikely = 0.5 * (one.logs + count_ * std::log(one.scale(count_)));
        find_best();
    }

    void find_best() {
        best_ = 0;
        for (std::size_t i = 1; i < members_.size(); ++i) {
            if (members_[i].unlikely < members_[best_].unlikely) best_ = i;
        }
        for (Member& one : members_) one.weight = std::exp(members_[best_].unlikely - one.unlikely);
    }

    const BankMembers* all_;
    int count_ = 0;
    std::size_t best_ = 0;
    std::vector<Member> members_;
};

constexpr double WalkBank::kHopeless;
constexpr double WalkBank::kNegligible;

}  // namespace track
}  // namespace fltea
