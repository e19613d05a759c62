// Tests whether the innovations of a filter are white and as large as predicted. If the filter's model is
// right, the innovations are uncorrelated, and the mean of their squares divided by the predicted variance is
// 1 (Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2).
// If the noise has passed a low-pass filter, neighbouring innovations may be uncorrelated while those at
// larger distances are correlated, so testing neighbours alone is not enough.
#pragma once

#include <cstddef>
#include <cstring>

namespace fltea {

// All statistics are computed from the newest innovations, up to 1,000 of them. They are NaN before the first
// 200 innovations.
class Whiteness {
  public:
    void add(double innovation, double std) {
        const double* const last = window_ + at_;  // the newest innovations, the latest one first
        if (before_ == kLags) {
            for (int lag = 0; lag < kLags; ++lag) now_.products[lag] += innovation * last[lag];
        } else {
            for (int lag = 0; lag < before_; ++lag) now_.products[lag] += innovation * last[lag];
            ++before_;
        }
        if (at_ == 0) {
            std::memmove(window_ + kBlock, window_, kLags * sizeof(double));
            at_ = kBlock;
        }
        window_[--at_] = innovation;
        if (std > 0) now_.normalised += (innovation / std) * (innovation / std);
        now_.squares += innovation * innovation;
        if (++now_.n < kBlock) return;
        if (kept_ == kBlocks) {
            for (int i = 1; i < kBlocks; ++i) blocks_[i - 1] = blocks_[i];
            --kept_;
        }
        blocks_[kept_++] = now_;
        now_ = Sums();
        white_ = ljung_box().value < kColoured;
    }

    // Whether the innovations were white when the last block of a hundred innovations was complete. The
    // result does not depend on how often this function is called.
    bool is_white() const { return white_; }

    // Call this if an innovation is missing. The next innovation then has no neighbour before it.
    void skip() { before_ = 0; }

    // Correlation of neighbouring innovations. For n white innovations it has the mean 0 and the standard
    // deviation 1/sqrt(n).
    double lag1() const {
        const Sums all = sum();
        return all.n >= kFewest && all.squares > 0 ? all.products[0] / all.squares : __builtin_nan("");
    }

    // Mean of the ratio of each squared innovation to its predicted variance (NIS). It is about 1 if the
    // predicted variance is right.
    double nis() const {
        const Sums all = sum();
        return all.n >= kFewest ? all.normalised / all.n : __builtin_nan("");
    }

    // The Ljung-Box statistic of the newest `n` innovations. For white innovations it has the distribution χ²
    // with kLags degrees of freedom.
    struct LjungBox {
        double value;
        int n;
    };
    LjungBox ljung_box() const {
        const Sums all = sum();
        if (all.n < kFewest || !(all.squares > 0)) return LjungBox{__builtin_nan(""), all.n};
        double total = 0;
        for (int lag = 0; lag < kLags; ++lag) {
            const double r = all.products[lag] / all.squares;
            total += r * r / (all.n - lag - 1);
        }
        return LjungBox{total * all.n * (all.n + 2.0), all.n};
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(kept_, 0, kBlocks);
        io.number(before_, 0, kLags);
        io.number(white_, 0, 1);
        for (int i = 0; i < kept_ && io.sound(); ++i) {
            blocks_[i].visit(io);
            io.require(blocks_[i].n == kBlock);
        }
        now_.visit(io);
        io.require(now_.n < kBlock);
        for (int lag = 0; lag < before_ && io.sound(); ++lag) io.real(window_[at_ + lag], -kMost, kMost);
    }

  private:
    static const int kLags = 20;
    static constexpr double kMost = 1e150;
    struct Sums {
        int n = 0;
        double products[kLags] = {}, squares = 0, normalised = 0;

        template <typename Io>
        void visit(Io& io) {
            io.number(n, 0, kBlock);
            for (double& one : products) io.real(one, -kMost * kMost, kMost * kMost);
            io.real(squares, 0, kMost * kMost);
            io.real(normalised, 0, kMost * kMost);
        }
    };
    static const int kBlock = 100, kBlocks = 9, kFewest = 200;
    // Limit of the Ljung-Box statistic. White innovations exceed it once in a thousand cases. For the verdict
    // "coloured", innovation_whiteness.py also requires correlations above a limit (COLOURED). Of 1,000
    // innovations or fewer, such a large statistic always means larger correlations, so that limit is not
    // needed here.
    static constexpr double kColoured = 45.314746618125859;

    Sums sum() const {
        Sums all;
        for (int i = 0; i < kept_; ++i) add(all, blocks_[i]);
        add(all, now_);
        return all;
    }
    static void add(Sums& to, const Sums& from) {
        to.n += from.n;
        for (int lag = 0; lag < kLags; ++lag) to.products[lag] += from.products[lag];
        to.squares += from.squares;
        to.normalised += from.normalised;
    }

    // sums from which the statistics are computed, for each complete block of a hundred innovations, oldest
    // block first
    Sums blocks_[kBlocks];
    Sums now_;
    int kept_ = 0;
    bool white_ = false;
    double window_[kBlock + kLags] = {};  // in window_, the newest kLags innovations begin at index at_
    int at_ = kBlock, before_ = 0;        // before_: innovations since the last missing one, at most kLags
};

}  // namespace fltea
