// The start-up window of one axis: computes the mean and the variance of the first samples, which the filters
// need before they begin. The algorithm assumes noise with the mean zero and a known variance R, and is
// sensitive to errors of both. The algorithm of the paper diverges if white noise of variance 0.0235
// (deg/s)^2 has an offset of 1 deg/s, or if R is four times too small. A real MPU-9250 has offsets of up to
// ±5 deg/s. The board computes mean and variance from counts, and the host from doubles, with the same
// template.
#pragma once

#include <stdint.h>

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The types in which samples of type T are summed.
template <class T>
struct Sums;

// Counts are summed exactly, in integers.
template <>
struct Sums<int16_t> {
    typedef float Real;
    typedef uint16_t Size;
    typedef int32_t Sum, Pairs;
    typedef int64_t Squares;
    static constexpr bool kFromFirst = false;
};

// Doubles are summed as differences from the first sample. The mean of these differences is about as large as
// the noise. The variance is computed from the sum of their squares. For n samples, it therefore loses at
// most a factor n of precision.
template <>
struct Sums<double> {
    typedef double Real, Sum, Pairs, Squares;
    typedef uint64_t Size;
    static constexpr bool kFromFirst = true;
};

template <class T>
class Baseline {
  public:
    typedef typename Sums<T>::Real Real;
    typedef typename Sums<T>::Size Size;

    void add(T value) {
        if (Sums<T>::kFromFirst && n_ == 0) first_ = value;
        const Sum distance = Sums<T>::kFromFirst ? value - first_ : value;
        ++n_;
        sum_ += distance;
        squares_ += static_cast<Squares>(distance) * distance;
    }

    Size samples() const { return n_; }

    // Whether all samples are equal. The variance R of the noise is then not known.
    bool constant() const { return spread() == 0; }

    // Mean, in the unit of the samples.
    Real bias() const {
        const Real mean = static_cast<Real>(sum_) / static_cast<Real>(n_);
        return Sums<T>::kFromFirst ? static_cast<Real>(first_) + mean : mean;
    }

    // Variance of a sample, but at least the variance that rounding to the resolution causes. Call this after
    // two or more samples.
    Real variance(Real resolution = Real(1)) const {
        const Real rounding = resolution * resolution / Real(12);
        const Real pairs = static_cast<Real>(static_cast<Pairs>(n_) * static_cast<Pairs>(n_ - 1));
        const Real found = static_cast<Real>(spread()) / pairs;
        return found < rounding ? rounding : found;
    }

    // Returns a count minus the mean of the samples. Everything but the final division is computed in
    // integers.
    Real centred(T value) const {
        static_assert(!Sums<T>::kFromFirst, "sums must be those of the samples themselves");
        return static_cast<Real>(static_cast<Sum>(value) * n_ - sum_) / static_cast<Real>(n_);
    }

  private:
    typedef typename Sums<T>::Sum Sum;
    typedef typename Sums<T>::Pairs Pairs;
    typedef typename Sums<T>::Squares Squares;

    // Variance of the n samples, multiplied by n (n - 1).
    Squares spread() const {
        return static_cast<Squares>(n_) * squares_ - static_cast<Squares>(sum_) * static_cast<Squares>(sum_);
    }

    Squares squares_ = 0;
    Sum sum_ = 0;
    Size n_ = 0;
    T first_ = 0;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
