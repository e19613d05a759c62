// The start-up window of one axis: mean and variance of its counts, exactly. The same rules as on the host
// (host/fltea/estimator/bias.py).
#pragma once

#include <stdint.h>

namespace fltea {

class Baseline {
  public:
    void add(int16_t count) {
        ++n_;
        sum_ += count;
        squares_ += static_cast<int64_t>(count) * count;
    }

    uint16_t samples() const { return n_; }

    // An axis that never changed has no R.
    bool constant() const { return spread() == 0; }

    // Mean [LSB].
    float bias() const { return static_cast<float>(sum_) / static_cast<float>(n_); }

    // Variance of a sample [LSB^2], at least that of the quantisation; for two samples or more.
    float variance() const {
        const float pairs = static_cast<float>(static_cast<int32_t>(n_) * (n_ - 1));
        const float found = static_cast<float>(spread()) / pairs;
        return found < kQuantisation ? kQuantisation : found;
    }

    // What is left of a count without the mean [LSB]; in integers up to the division.
    float centred(int16_t count) const {
        return static_cast<float>(static_cast<int32_t>(count) * n_ - sum_) / static_cast<float>(n_);
    }

  private:
    static constexpr float kQuantisation = 1.0f / 12.0f;

    // n (n - 1) times the variance.
    int64_t spread() const { return n_ * squares_ - static_cast<int64_t>(sum_) * sum_; }

    int64_t squares_ = 0;
    int32_t sum_ = 0;
    uint16_t n_ = 0;
};

}  // namespace fltea
