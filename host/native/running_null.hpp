// Is it white? A running test of the measurements of several axes that are sampled together; what it does and
// why stands in host/fltea/estimator/running_null.py.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

namespace fltea {

namespace running_null {

constexpr std::size_t kLags = 8, kFactor = 4, kLevels = 8;
// Values that a level takes at a time.
constexpr std::size_t kChunk = 128;
constexpr double kFewest = 1000, kFewestPairs = 100;
constexpr double kLevel = 0.001;
constexpr int kEffective = 8;

// Sums over pairs of blocks of one size; a row whose first number is NaN is a block that is not whole. The
// mean of the first values is taken off as they come, against rounding and because the standard deviations
// need it; what is left of the mean is taken out of the sums of products at the end.
class Level {
  public:
    explicit Level(std::size_t axes)
        : axes_(axes),
          pairs_(kLags, 0),
          tail_(kLags * axes, nan()),
          products_(kLags * axes, 0),
          squares_(products_),
          both_(products_),
          sum_(axes, 0),
          sum_of_squares_(axes, 0),
          origin_(axes, nan()) {}

    double count() const { return count_; }
    bool known() const { return pairs_[kLags - 1] >= kFewestPairs; }

    // Takes kChunk rows and leaves them without their first mean.
    void add(double* rows) {
        if (std::isnan(origin_[0]) && !find_origin(rows)) return;
        for (std::size_t i = 0; i < kChunk * axes_; ++i) rows[i] -= origin_[i % axes_];
        double present[kLags + kChunk], y[kLags + kChunk];
        for (std::size_t t = 0; t < kLags + kChunk; ++t) present[t] = std::isnan(at(rows, t)[0]) ? 0 : 1;
        for (std::size_t t = kLags; t < kLags + kChunk; ++t) {
            count_ += present[t];
            for (std::size_t lag = 1; lag <= kLags; ++lag) pairs_[lag - 1] += present[t - lag] * present[t];
        }
        for (std::size_t axis = 0; axis < axes_; ++axis) {
            for (std::size_t t = 0; t < kLags + kChunk; ++t) y[t] = present[t] > 0 ? at(rows, t)[axis] : 0;
            add_axis(axis, y, present);
        }
        for (std::size_t i = 0; i < tail_.size(); ++i) tail_[i] = rows[(kChunk - kLags) * axes_ + i];
    }

    // The largest magnitude of the normal figures of an axis; NaN where the values never change.
    //
    // Where values hardly ever change (a deviation of a fifth of an LSB) hardly any product is other than 0,
    // and their own squares would say next to nothing of how they vary.
    double largest(std::size_t axis) const {
        const double mean = sum_[axis] / count_, mean2 = mean * mean;
        const double variance = sum_of_squares_[axis] / count_ - mean2;
        double products[kLags], squares[kLags], result = 0;
        for (std::size_t k = 0; k < kLags; ++k) {
            const std::size_t at = k * axes_ + axis;
            const double least = pairs_[k] * (variance * variance) / 2;
            products[k] = products_[at] - mean * both_[at] + pairs_[k] * (mean2 + variance / count_);
            squares[k] = squares_[at] < least || std::isnan(least) ? least : squares_[at];
            raise(result, std::fabs(products[k] / std::sqrt(squares[k])));
        }
        for (std::size_t span = 4; span <= 8; span += 4) {
            double sum = 0, power = 0;
            for (std::size_t k = 0; k + 1 < span; ++k) {
                const double weight = static_cast<double>(span - 1 - k);
                sum += weight * products[k];
                power += weight * weight * squares[k];
            }
            raise(result, std::fabs(sum / std::sqrt(power)));
        }
        return result;
    }

    // Rows that wait for a whole chunk, and all sums: as RunningNull::save() puts them.
    std::vector<double> waiting;

    void save(std::vector<double>& out) const {
        out.push_back(static_cast<double>(waiting.size() / axes_));
        out.push_back(count_);
        out.insert(out.end(), waiting.begin(), waiting.end());
        Level* const self = const_cast<Level*>(this);
        for (std::vector<double>* part : self->parts()) out.insert(out.end(), part->begin(), part->end());
    }

    // Returns what stands behind it; null if it cannot be a level.
    const double* load(const double* from, const double* end) {
        if (end - from < 2) return nullptr;
        const double rows = from[0];
        count_ = from[1];
        if (!(rows >= 0 && rows < static_cast<double>(kChunk) && is_whole(rows) && is_count(count_)))
            return nullptr;
        from += 2;
        waiting.resize(static_cast<std::size_t>(rows) * axes_);
        from = take(waiting, from, end);
        for (std::vector<double>* part : parts()) {
            if (from != nullptr) from = take(*part, from, end);
        }
        return from != nullptr && sound() ? from : nullptr;
    }

  private:
    static double nan() { return __builtin_nan(""); }
    static bool is_whole(double number) { return std::floor(number) == number; }
    static bool is_count(double number) { return number >= 0 && number <= 1e15 && is_whole(number); }
    // The larger one; NaN, once it was there, stays.
    static void raise(double& largest, double value) {
        if (!(value <= largest)) largest = std::isnan(largest) ? largest : value;
    }

    // Row t of the tail with a chunk behind it.
    const double* at(const double* rows, std::size_t t) const {
        return t < kLags ? tail_.data() + t * axes_ : rows + (t - kLags) * axes_;
    }

    // From the whole rows of the first chunk that has any.
    bool find_origin(const double* rows) {
        double whole = 0;
        const double* first = nullptr;
        std::vector<double> sum(axes_, 0);
        for (std::size_t t = 0; t < kChunk; ++t) {
            const double* const row = rows + t * axes_;
            if (std::isnan(row[0])) continue;
            if (first == nullptr) first = row;
            ++whole;
            for (std::size_t axis = 0; axis < axes_; ++axis) sum[axis] += row[axis] - first[axis];
        }
        if (first == nullptr) return false;
        // Exact if they are all the same.
        for (std::size_t axis = 0; axis < axes_; ++axis) origin_[axis] = first[axis] + sum[axis] / whole;
        return true;
    }

    // Lags run backwards here, so that what is 8 to 1 rows before stands in a row.
    void add_axis(std::size_t axis, const double* y, const double* present) {
        double products[kLags] = {}, squares[kLags] = {}, both[kLags] = {}, sum = 0, sum_of_squares = 0;
        for (std::size_t t = kLags; t < kLags + kChunk; ++t) {
            const double now = y[t], here = present[t];
            const double *const before = y + t - kLags, *const there = present + t - kLags;
            for (std::size_t i = 0; i < kLags; ++i) {
                const double product = before[i] * now;
                products[i] += product;
                squares[i] += product * product;
                both[i] += there[i] * now + before[i] * here;
            }
            sum += now;
            sum_of_squares += now * now;
        }
        for (std::size_t i = 0; i < kLags; ++i) {
            const std::size_t place = (kLags - 1 - i) * axes_ + axis;
            products_[place] += products[i];
            squares_[place] += squares[i];
            both_[place] += both[i];
        }
        sum_[axis] += sum;
        sum_of_squares_[axis] += sum_of_squares;
    }

    static const double* take(std::vector<double>& to, const double* from, const double* end) {
        if (static_cast<std::size_t>(end - from) < to.size()) return nullptr;
        to.assign(from, from + to.size());
        return from + to.size();
    }

    struct Parts {
        std::vector<double>* part[8];
        std::vector<double>* const* begin() const { return part; }
        std::vector<double>* const* end() const { return part + 8; }
    };
    Parts parts() {
        return Parts{{&pairs_, &tail_, &products_, &squares_, &both_, &sum_, &sum_of_squares_, &origin_}};
    }

    // Whether what was loaded can have come of add().
    bool sound() const {
        for (double pairs : pairs_) {
            if (!(is_count(pairs) && pairs <= count_)) return false;
        }
        const std::vector<double>* const finite[] = {&products_, &squares_, &both_, &sum_, &sum_of_squares_};
        for (const std::vector<double>* part : finite) {
            for (double number : *part) {
                if (!std::isfinite(number)) return false;
            }
        }
        for (double number : squares_) {
            if (number < 0) return false;
        }
        for (double number : sum_of_squares_) {
            if (number < 0) return false;
        }
        if (!whole_rows(tail_) || !whole_rows(waiting) || !whole_rows(origin_)) return false;
        return !std::isnan(origin_[0]) || count_ == 0;
    }

    // Every row finite, or all of it NaN.
    bool whole_rows(const std::vector<double>& rows) const {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const bool lost = std::isnan(rows[i - i % axes_]);
            if (lost ? !std::isnan(rows[i]) : !std::isfinite(rows[i])) return false;
        }
        return true;
    }

    std::size_t axes_;
    double count_ = 0;
    std::vector<double> pairs_;                          // (lags,)
    std::vector<double> tail_;                           // (lags, axes), the newest last
    std::vector<double> products_, squares_, both_;      // (lags, axes)
    std::vector<double> sum_, sum_of_squares_, origin_;  // (axes,)
};

// Probability that the largest magnitude of so many independent normal figures is no smaller.
inline double p_value(double largest, int effective) {
    const double single = std::erfc(largest / std::sqrt(2.0));
    return single < 1 ? -std::expm1(effective * std::log1p(-single)) : 1.0;
}

// To three digits, as it is published.
inline double rounded(double p) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", p);
    return std::strtod(text, nullptr);
}

}  // namespace running_null

// Takes one row at a time; its answers change with every 128th. A lost sample takes the pairs and blocks that
// it belongs to with it; nothing is made up for it.
class RunningNull {
  public:
    // axes: one or more.
    explicit RunningNull(std::size_t axes) : axes_(axes), lost_(axes, __builtin_nan("")), p_(lost_) {
        levels_.emplace_back(axes);
    }

    std::size_t axes() const { return axes_; }

    // One sample of every axis, in any unit.
    void add(const double* row) {
        std::vector<double>& waiting = levels_[0].waiting;
        waiting.insert(waiting.end(), row, row + axes_);
        if (waiting.size() == running_null::kChunk * axes_) {
            take_chunk(0);
            judge();
        }
    }

    // A lost sample.
    void skip() { add(lost_.data()); }

    // How often white noise would look at least as unlike white, at one moment; NaN while not known.
    double p(std::size_t axis) const { return p_[axis]; }
    bool not_white(std::size_t axis) const { return p_[axis] < running_null::kLevel; }

    // Levels that have enough pairs to count; 0 before 1,000 samples.
    int depth() const {
        if (levels_[0].count() < running_null::kFewest) return 0;
        int depth = 0;
        for (const running_null::Level& level : levels_) depth += level.known();
        return depth;
    }

    // The statistic of an axis; NaN where it never changed, or where nothing is known.
    double largest(std::size_t axis) const {
        double result = __builtin_nan("");
        for (const running_null::Level& level : levels_) {
            if (level.known()) result = std::fmax(result, level.largest(axis));
        }
        return result;
    }

    // All of it, level after level.
    std::vector<double> save() const {
        std::vector<double> numbers;
        for (const running_null::Level& level : levels_) level.save(numbers);
        return numbers;
    }

    // False, and nothing has changed, if these numbers cannot come from save() of as many axes.
    bool load(const double* numbers, std::size_t size) {
        const double *from = numbers, *const end = numbers + size;
        std::vector<running_null::Level> levels;
        while (from != end) {
            levels.emplace_back(axes_);
            from = levels.back().load(from, end);
            if (from == nullptr || levels.size() > running_null::kLevels) return false;
        }
        if (levels.empty()) return false;
        levels_ = levels;
        judge();
        return true;
    }

  private:
    void take_chunk(std::size_t place) {
        std::vector<double> rows;
        rows.swap(levels_[place].waiting);
        levels_[place].add(rows.data());
        if (place + 1 == running_null::kLevels) return;
        if (place + 1 == levels_.size()) levels_.emplace_back(axes_);
        std::vector<double>& above = levels_[place + 1].waiting;
        for (std::size_t t = 0; t < running_null::kChunk; t += running_null::kFactor) {
            for (std::size_t axis = 0; axis < axes_; ++axis) {
                double sum = 0;
                for (std::size_t i = 0; i < running_null::kFactor; ++i) sum += rows[(t + i) * axes_ + axis];
                above.push_back(sum);
            }
        }
        if (above.size() == running_null::kChunk * axes_) take_chunk(place + 1);
    }

    void judge() {
        const int effective = running_null::kEffective * depth();
        for (std::size_t axis = 0; axis < axes_; ++axis) {
            const double statistic = largest(axis);
            p_[axis] = effective == 0 || !std::isfinite(statistic)
                           ? __builtin_nan("")
                           : running_null::rounded(running_null::p_value(statistic, effective));
        }
    }

    std::size_t axes_;
    std::vector<double> lost_, p_;
    std::vector<running_null::Level> levels_;
};

}  // namespace fltea
