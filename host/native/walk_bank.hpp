// What is known of a bias while nobody knows the noise: random walks and relaxations in white noise, of all
// speeds, each weighted by how likely it made the samples. Their scale is found from the samples.
#pragma once

#include "kalman.hpp"

namespace fltea {
namespace track {

class WalkBank {
  public:
    enum { kWalks = 9, kTimes = 5, kPowers = 3, kMembers = kWalks + kTimes * kPowers, kFewest = 16 };

    WalkBank() {
        for (int i = 0; i < kMembers; ++i) {
            sums_[i] = squares_[i] = 0;
            filters_[i].start(&table().systems[i], &table().maps[i]);
        }
    }

    // Whether there were enough samples for the scale.
    bool knows() const { return count_ >= kFewest; }

    void predict(double y) {
        for (int i = 0; i < kMembers; ++i) e_[i] = filters_[i].innovation(y);
    }
    // Of the likeliest member, and its variance.
    double innovation() const { return e_[best_]; }
    double variance() const { return filters_[best_].S * scale(best_); }

    void go_on(bool take) {
        for (int i = 0; i < kMembers; ++i) {
            if (take) {
                const double S = filters_[i].S;
                sums_[i] += std::log(S);
                squares_[i] += e_[i] * e_[i] / S;
            }
            filters_[i].go_on(e_[i], take);
        }
        if (!take) return;
        ++count_;
        for (int i = 0; i < kMembers; ++i) {
            if (minus_log(i) < minus_log(best_)) best_ = i;
        }
    }

    // In units of the samples; nothing is a state of its own.
    Known known() const {
        Known all = Known{0, 0, 0, 0, innovation(), variance()};
        double weights = 0, squares = 0;
        const double least = minus_log(best_);
        for (int i = 0; i < kMembers; ++i) {
            const double apart = minus_log(i) - least;
            if (apart > 40) continue;
            const double weight = std::exp(-apart);
            const Known one = filters_[i].known(0);
            weights += weight;
            all.bias += weight * one.bias;
            squares += weight * (one.bias_variance * scale(i) + one.bias * one.bias);
        }
        all.bias /= weights;
        const double variance = squares / weights - all.bias * all.bias;
        // Of an axis that has never changed there is no scale.
        all.bias_variance = variance > kNothing ? variance : 0;
        all.state = all.bias;
        all.state_variance = all.bias_variance;
        return all;
    }

    // 2 log L of the samples by the likeliest member, but for a constant.
    double likelihood() const { return -2 * minus_log(best_) - count_; }

    template <typename Io>
    void visit(Io& io) {
        io.number(count_, 0, 1e9);
        io.number(best_, 0, kMembers - 1);
        for (int i = 0; i < kMembers && io.sound(); ++i) {
            io.real(sums_[i], -1e300, 1e300);
            io.real(squares_[i], 0, 1e300);
            io.real(e_[i], -1e150, 1e150);
            filters_[i].visit(io);
        }
    }

  private:
    typedef System<2> Two;
    struct Table {
        Two systems[kMembers];
        RiccatiMap<2> maps[kMembers];
        Table() {
            // Variance of a walk's step over that of the white noise: 0 is an offset alone.
            const double walks[kWalks] = {0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1};
            const double times[kTimes] = {1.5, 5, 20, 80, 320}, powers[kPowers] = {0.1, 1, 10};
            for (int i = 0; i < kMembers; ++i) {
                Two& s = systems[i];
                s = Two();
                s.R = 1;
                s.n = i < kWalks ? 1 : 2;
                const int k = i - kWalks;
                s.a[0] = s.c[0] = s.bias[0] = 1;
                s.Q[0] = i < kWalks ? walks[i] : 0;
                double power = 0;
                if (k >= 0) {
                    const double a = std::exp(-1 / times[k / kPowers]);
                    power = powers[k % kPowers];
                    s.a[1] = a;
                    s.c[1] = s.bias[1] = 1;
                    s.Q[3] = power * (1 - a * a);
                    s.P0[3] = power;
                }
                s.P0[0] = 1e4 * (1 + power);
                maps[i].set(s);
            }
        }
    };
    static const Table& table() {
        static const Table one;
        return one;
    }

    double scale(int i) const { return count_ > 0 && squares_[i] > 0 ? squares_[i] / count_ : 1e-300; }
    double minus_log(int i) const { return 0.5 * (sums_[i] + count_ * std::log(scale(i))); }

    int count_ = 0, best_ = 0;
    double sums_[kMembers], squares_[kMembers], e_[kMembers] = {0};
    Kalman<2> filters_[kMembers];
};

}  // namespace track
}  // namespace fltea
