// Whether the innovations of a filter are white, and as large as it thinks. Of a filter whose model is right
// they are uncorrelated, and their squares over the variance that it predicts have the mean 1 (Bar-Shalom, Li
// & Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2).
#pragma once

#include <cstddef>

namespace fltea {

// Both figures over the last 1,000 innovations, give or take a hundred; NaN before 200.
class Whiteness {
  public:
    void add(double innovation, double std) {
        if (follows_) now_.products += innovation * last_;
        last_ = innovation;
        follows_ = true;
        if (std > 0) now_.normalised += (innovation / std) * (innovation / std);
        now_.squares += innovation * innovation;
        if (++now_.n < kBlock) return;
        if (kept_ == kBlocks) {
            for (int i = 1; i < kBlocks; ++i) blocks_[i - 1] = blocks_[i];
            --kept_;
        }
        blocks_[kept_++] = now_;
        now_ = Sums();
    }

    // There was no innovation: what follows has no neighbour.
    void skip() { follows_ = false; }

    // Correlation of neighbours, 0 ± 1/sqrt(n) for white innovations.
    double lag1() const {
        const Sums all = sum();
        return all.n >= kFewest && all.squares > 0 ? all.products / all.squares : __builtin_nan("");
    }

    // Mean normalised innovation squared; 1 where the filter's variance is right.
    double nis() const {
        const Sums all = sum();
        return all.n >= kFewest ? all.normalised / all.n : __builtin_nan("");
    }

  private:
    struct Sums {
        int n = 0;
        double products = 0, squares = 0, normalised = 0;
    };
    static const int kBlock = 100, kBlocks = 9, kFewest = 200;

    Sums sum() const {
        Sums all;
        for (int i = 0; i < kept_; ++i) add(all, blocks_[i]);
        add(all, now_);
        return all;
    }
    static void add(Sums& to, const Sums& from) {
        to.n += from.n;
        to.products += from.products;
        to.squares += from.squares;
        to.normalised += from.normalised;
    }

    Sums blocks_[kBlocks];  // oldest first
    Sums now_;
    int kept_ = 0;
    double last_ = 0;
    bool follows_ = false;
};

}  // namespace fltea
