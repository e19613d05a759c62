// Computes the Allan variance of one axis in constant memory. The estimates are overlapping ones at τ = 2^j
// samples, and are computed from running sums.
//
// Let B_k be the sum of the m = 2^j samples that end at sample k. Then σ²(m) is the mean of (B_k - B_{k-m})²
// / (2 m²). For m up to 8, every k is used. For larger m, every (m/8)-th k is used; this loses almost no
// information, because neighbouring terms are nearly equal. The octave with m = 2^(3 + i) therefore needs
// only the last 16 sums of 2^i samples. These sums are the values of level i; level 0 has the samples, and
// each further level has the sums of pairs of the level below.
//
// Each level processes its values in chunks of kChunk, counted from the last break in the series. The results
// therefore do not depend on how callers split the samples into calls.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace fltea {

namespace allan {

constexpr std::size_t kChunk = 16, kHistory = 15;
// Octave j of the Allan variance is the estimate at τ = 2^j samples. Octaves 0 to 3 are computed from level
// 0, which has the samples. Each octave j above 3 is computed from level j - 3.
constexpr std::size_t kLevels = 24, kOfSamples = 4, kOctaves = kLevels + kOfSamples - 1;
// Old terms are forgotten exponentially. A point of the Allan variance is left out if its newest term is
// older than this many time constants of the forgetting.
constexpr double kOldest = 3;
constexpr double kLargestValue = 1e100, kLargestCount = 1e15;

// Sums for one octave: of the terms (B_k - B_{k-m})², each multiplied by its weight (see the top of this
// file), of the weights, and of the squared weights. A new term has the weight 1. If samples are forgotten,
// older terms have smaller weights.
struct Octave {
    double squares = 0, weight = 0, weight_squared = 0;
    // Time at which the last term was added, in samples since the beginning of the series.
    double last = 0;
};

struct Level {
    // The first kHistory elements are the last values of earlier chunks since the last break, or 0 where
    // there are too few such values. After them come the values of the present chunk, of which there are
    // `waiting`. These are processed when the chunk is complete.
    double values[kHistory + kChunk] = {};
    std::size_t waiting = 0;
    // Number of values since the last break that were already processed. Waiting values are not included.
    double taken = 0;
};

struct Point {
    double factor, avar;
    // Effective number of the overlapping terms that were averaged. If no samples are forgotten, it is the
    // exact number of these terms.
    double terms;
};

}  // namespace allan

class AllanSums {
  public:
    // `memory_samples`: time constant of the exponential forgetting [samples]; 0: nothing is forgotten.
    explicit AllanSums(double memory_samples = 0) : memory_(memory_samples) {
        for (std::size_t i = 0; i < allan::kLevels; ++i) {
            step_decay_[i] = memory_ > 0 ? std::exp(-std::ldexp(1.0, static_cast<int>(i)) / memory_) : 1;
        }
    }

    // Number of all samples that were added.
    double samples() const { return samples_; }
    // Number of recent samples that the results describe; older samples are forgotten.
    double span() const {
        const double oldest = allan::kOldest * memory_;
        return memory_ > 0 && oldest < samples_ ? oldest : samples_;
    }

    // Adds `n` samples. Each sample has to be finite and at most kLargestValue in magnitude.
    void add(const double* y, std::size_t n) {
        if (n == 0) return;
        if (!begun_) {
            // The origin, a fixed value, is subtracted from the samples, so that a large offset causes no
            // rounding errors in the sums. The origin cancels in the differences of sums.
            origin_ = y[0];
            begun_ = true;
        }
        allan::Level& level = levels_[0];
        for (std::size_t i = 0; i < n; ++i) {
            level.values[allan::kHistory + level.waiting++] = y[i] - origin_;
            if (level.waiting == allan::kChunk) take(0);
        }
        samples_ += static_cast<double>(n);
        now_ += static_cast<double>(n);
    }

    // Notes a break in the series with `lost` missing samples. No term uses samples from both sides of a
    // break.
    void cut(double lost = 0) {
        for (std::size_t i = 0; i < allan::kLevels; ++i) {
            if (levels_[i].waiting > 0) take(i);
            levels_[i] = allan::Level();
        }
        begun_ = false;
        now_ += lost;
        stretch_begin_ = now_;
    }

    // Adds the sums of another instance, as if the two series ended at the same time. First, both instances
    // process the values of their incomplete chunks. The next sample begins a new stretch (samples without a
    // gap) of this instance's series.
    void merge(const AllanSums& other) {
        if (other.samples_ <= 0) return;
        AllanSums ended(other);
        ended.cut();
        cut();
        samples_ += ended.samples_;
        now_ += ended.now_;
        stretch_begin_ = now_;
        for (std::size_t j = 0; j < allan::kOctaves; ++j) {
            allan::Octave &mine = octaves_[j], &theirs = ended.octaves_[j];
            fade(mine, now_ - ended.now_ - mine.last);
            fade(theirs, ended.now_ - theirs.last);
            mine.squares += theirs.squares;
            mine.weight += theirs.weight;
            mine.weight_squared += theirs.weight_squared;
            mine.last = now_;
        }
    }

    // Returns a point of the Allan variance for each octave that has at least one term.
    std::vector<allan::Point> points() const {
        AllanSums ended(*this);
        ended.cut();
        std::vector<allan::Point> result;
        for (std::size_t j = 0; j < allan::kOctaves; ++j) {
            const allan::Octave& octave = ended.octaves_[j];
            const double m = std::ldexp(1.0, static_cast<int>(j)), oldest = allan::kOldest * memory_;
            if (!(octave.weight > 0)) continue;
            if (memory_ > 0 && (2 * m > oldest || ended.now_ - octave.last > oldest)) continue;
            const double avar = octave.squares / octave.weight / (2 * m * m);
            result.push_back({m, avar, octave.weight * octave.weight / octave.weight_squared});
        }
        return result;
    }

    // Returns the state as a list of numbers. The first four are the sample count, the current time, the time
    // since the last break, and the origin, which is subtracted from each sample. The values of all levels
    // (struct Level) follow, and then the four numbers of each octave (struct Octave).
    std::vector<double> save() const {
        const double length = begun_ ? now_ - stretch_begin_ : 0;
        std::vector<double> numbers = {samples_, now_, length, begun_ ? origin_ : 0};
        for (const allan::Level& level : levels_) {
            numbers.insert(numbers.end(), level.values + allan::kHistory - history(level),
                           level.values + allan::kHistory + level.waiting);
        }
        for (const allan::Octave& octave : octaves_) {
            numbers.insert(numbers.end(),
                           {octave.squares, octave.weight, octave.weight_squared, octave.last});
        }
        return numbers;
    }

    // Restores the state from the result of save(). Returns false and changes nothing if save() cannot have
    // returned these numbers.
    bool load(const double* numbers, std::size_t size) {
        AllanSums found(memory_);
        if (!found.read(numbers, numbers + size)) return false;
        *this = found;
        return true;
    }

  private:
    static std::size_t history(const allan::Level& level) {
        return level.taken < static_cast<double>(allan::kHistory) ? static_cast<std::size_t>(level.taken)
                                                                  : allan::kHistory;
    }

    // Processes the waiting values of level i (Level::waiting): computes terms of the Allan variance from
    // them, and passes the sum of each two of them to level i + 1.
    void take(std::size_t i) {
        allan::Level& level = levels_[i];
        const std::size_t n = level.waiting, old = history(level);
        constexpr std::size_t kAll = allan::kHistory + allan::kChunk;
        double of2[kAll] = {}, of4[kAll] = {}, of8[kAll] = {};
        const double* const v = level.values;
        for (std::size_t k = 1; k < kAll; ++k) of2[k] = v[k] + v[k - 1];
        for (std::size_t k = 3; k < kAll; ++k) of4[k] = of2[k] + of2[k - 2];
        for (std::size_t k = 7; k < kAll; ++k) of8[k] = of4[k] + of4[k - 4];
        if (i == 0) {
            count(0, i, v, 1, old, n);
            count(1, i, of2, 2, old, n);
            count(2, i, of4, 4, old, n);
        }
        count(i + 3, i, of8, 8, old, n);
        level.waiting = 0;
        level.taken += static_cast<double>(n);
        if (i + 1 < allan::kLevels) {
            allan::Level& above = levels_[i + 1];
            for (std::size_t k = 0; k + 1 < n; k += 2) {
                above.values[allan::kHistory + above.waiting++] = of2[allan::kHistory + k + 1];
            }
            if (above.waiting == allan::kChunk) take(i + 1);
        }
        for (std::size_t k = 0; k < allan::kHistory; ++k) level.values[k] = level.values[k + n];
    }

    // Adds terms (B_k - B_{k-m})² to octave j, where m = 2^j. `sums` has the block sum B that ends at each
    // value of level i. B_{k-m} stands `width` values before B_k.
    void count(std::size_t j, std::size_t i, const double* sums, std::size_t width, std::size_t old,
               std::size_t n) {
        const std::size_t needed = 2 * width - 1, first = old < needed ? needed - old : 0;
        if (first >= n) return;
        const double* const newer = sums + allan::kHistory;
        const double* const older = newer - width;
        allan::Octave& octave = octaves_[j];
        const double step = std::ldexp(1.0, static_cast<int>(i)), taken = levels_[i].taken;
        if (memory_ > 0) {
            const double decay = step_decay_[i], decay2 = decay * decay;
            // The time since the octave's last term decides how much the sums fade. It may be long if the
            // series had a break meanwhile.
            fade(octave, stretch_begin_ + (taken + static_cast<double>(first + 1)) * step - octave.last);
            double squares = octave.squares, weight = octave.weight, both = octave.weight_squared;
            for (std::size_t k = first; k < n; ++k) {
                const double apart = newer[k] - older[k];
                if (k > first) {
                    squares *= decay;
                    weight *= decay;
                    both *= decay2;
                }
                squares += apart * apart;
                weight += 1;
                both += 1;
            }
            octave.squares = squares;
            octave.weight = weight;
            octave.weight_squared = both;
        } else if (first == 0 && n == allan::kChunk) {
            double part[4] = {};
            for (std::size_t k = 0; k < allan::kChunk; k += 4) {
                for (std::size_t l = 0; l < 4; ++l) {
                    const double apart = newer[k + l] - older[k + l];
                    part[l] += apart * apart;
                }
            }
            octave.squares += (part[0] + part[2]) + (part[1] + part[3]);
            octave.weight += static_cast<double>(allan::kChunk);
            octave.weight_squared = octave.weight;
        } else {
            for (std::size_t k = first; k < n; ++k) {
                const double apart = newer[k] - older[k];
                octave.squares += apart * apart;
            }
            octave.weight += static_cast<double>(n - first);
            octave.weight_squared += static_cast<double>(n - first);
        }
        octave.last = stretch_begin_ + (taken + static_cast<double>(n)) * step;
    }

    void fade(allan::Octave& octave, double age) const {
        if (!(memory_ > 0)) return;
        const double decay = std::exp(-age / memory_);
        octave.squares *= decay;
        octave.weight *= decay;
        octave.weight_squared *= decay * decay;
        // Much smaller weights would underflow to 0 when they are squared. The octave is therefore reset
        // before.
        if (octave.weight < 1e-100) octave = allan::Octave();
    }

    static bool is_count(double number) {
        return number >= 0 && number <= allan::kLargestCount && std::floor(number) == number;
    }

    bool read(const double* from, const double* end) {
        if (end - from < 4) return false;
        samples_ = from[0];
        now_ = from[1];
        const double length = from[2];
        origin_ = from[3];
        if (!is_count(samples_) || !is_count(now_) || !is_count(length)) return false;
        if (length > samples_ || samples_ > now_ || !(std::fabs(origin_) <= allan::kLargestValue))
            return false;
        from += 4;
        begun_ = length > 0;
        stretch_begin_ = now_ - length;
        double values = length, largest = 2 * allan::kLargestValue;
        for (allan::Level& level : levels_) {
            const double chunks = std::floor(values / static_cast<double>(allan::kChunk));
            level.taken = chunks * static_cast<double>(allan::kChunk);
            level.waiting = static_cast<std::size_t>(values - level.taken);
            const std::size_t old = history(level), n = old + level.waiting;
            if (static_cast<std::size_t>(end - from) < n) return false;
            for (std::size_t k = 0; k < n; ++k) {
                if (!(std::fabs(from[k]) <= largest)) return false;
                level.values[allan::kHistory - old + k] = from[k];
            }
            from += n;
            values = level.taken / 2;
            largest *= 2;
        }
        if (end - from != static_cast<std::ptrdiff_t>(4 * allan::kOctaves)) return false;
        for (allan::Octave& octave : octaves_) {
            octave.squares = from[0];
            octave.weight = from[1];
            octave.weight_squared = from[2];
            octave.last = from[3];
            if (!sound(octave)) return false;
            from += 4;
        }
        return true;
    }

    bool sound(const allan::Octave& octave) const {
        return octave.squares >= 0 && octave.squares <= 1e300 && octave.weight >= 0 &&
               octave.weight <= samples_ && octave.weight_squared >= 0 &&
               octave.weight_squared <= octave.weight && octave.last >= 0 && octave.last <= now_ &&
               (octave.weight > 0 ? octave.weight_squared > 0 : octave.squares <= 0);
    }

    double memory_;
    double step_decay_[allan::kLevels];
    double samples_ = 0, now_ = 0, stretch_begin_ = 0, origin_ = 0;
    bool begun_ = false;
    allan::Level levels_[allan::kLevels];
    allan::Octave octaves_[allan::kOctaves];
};

}  // namespace fltea
