// The past samples of an axis, which a filter processes again when it restarts with another noise model. The
// newest samples are kept singly. Older samples are kept as means, and the older they are, the more samples
// are in a mean. The size in memory is constant. At 100 Hz the means reach back nearly two days; older
// samples are forgotten.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace fltea {
namespace track {

// Samples are clipped at this magnitude, which no sensor reaches.
constexpr float kMostKnown = 1e37f;
inline float remembered(double y) {
    return y > kMostKnown ? kMostKnown : y < -kMostKnown ? -kMostKnown : float(y);
}

// Saves or loads a remembered number. NaN stands for an unknown one.
template <typename Io>
void visit_known(Io& io, float& value) {
    const double most = kMostKnown;
    double one = std::isnan(value) ? 2 * most : double(value);
    io.real(one, -most, 2 * most);
    value = one > most ? __builtin_nanf("") : float(one);
}

// A queue of the newest numbers, of which there are at most `size`. `size` is a multiple of kGroup. Unknown
// numbers are NaN.
template <int size>
class Newest {
  public:
    int count() const { return count_; }
    bool full() const { return count_ == size; }
    // The number at index i, where i = 0 is the oldest.
    double operator[](int i) const { return double(values_[(first_ + i) % size]); }
    void push(float value) {
        values_[(first_ + count_) % size] = value;
        ++count_;
    }
    // Removes the oldest `group` numbers. Returns the mean of those that are known, or NaN if less than half
    // of the removed numbers are known.
    float pop(int group) {
        double sum = 0;
        int known = 0;
        for (int i = 0; i < group; ++i) {
            const double one = (*this)[i];
            if (std::isnan(one)) continue;
            sum += one;
            ++known;
        }
        first_ = (first_ + group) % size;
        count_ -= group;
        return 2 * known >= group ? float(sum / known) : __builtin_nanf("");
    }
    void clear() { first_ = count_ = 0; }
    // Whether all numbers except the newest `but_newest` ones equal those of `other` bit by bit.
    bool is(const Newest& other, int but_newest) const {
        if (first_ != other.first_ || count_ != other.count_) return false;
        const int all = count_ - but_newest;
        const int to_end = all < size - first_ ? all : size - first_;
        return all <= 0 || (same(values_ + first_, other.values_ + first_, to_end) &&
                            same(values_, other.values_, all - to_end));
    }
    // Marks the newest `newest` numbers as unknown.
    void forget(int newest) {
        for (int i = count_ - newest < 0 ? 0 : count_ - newest; i < count_; ++i) {
            values_[(first_ + i) % size] = __builtin_nanf("");
        }
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(first_, 0, size - 1);
        io.number(count_, 0, size);
        for (int i = 0; i < count_ && io.sound(); ++i) visit_known(io, values_[(first_ + i) % size]);
    }

  private:
    static bool same(const float* one, const float* other, int n) {
        return std::memcmp(one, other, sizeof(float) * std::size_t(n)) == 0;
    }

    float values_[size];
    int first_ = 0, count_ = 0;
};

class Past {
  public:
    enum { kGroup = 32, kSingle = 2048, kMeans = 512, kLevels = 3 };

    // Appends the next kGroup samples to the past.
    void add(const float* y) {
        if (single_.full()) lift(single_.pop(kGroup), 0);
        for (int i = 0; i < kGroup; ++i) single_.push(y[i]);
    }
    void clear() {
        single_.clear();
        for (Newest<kMeans>& one : means_) one.clear();
    }
    // Whether all means and all samples that are kept singly equal those of `other`, apart from the newest
    // `but_newest` samples.
    bool is(const Past& other, int but_newest) const {
        for (int i = 0; i < kLevels; ++i) {
            if (!means_[i].is(other.means_[i], 0)) return false;
        }
        return single_.is(other.single_, but_newest);
    }
    // Marks the newest `newest` samples as unknown. Samples that are not kept singly any more stay as they
    // are.
    void forget(int newest) { single_.forget(newest); }
    const Newest<kSingle>& single() const { return single_; }
    // The queue of means, each over kGroup^(level + 1) samples.
    const Newest<kMeans>& means(int level) const { return means_[level]; }

    template <typename Io>
    void visit(Io& io) {
        single_.visit(io);
        for (Newest<kMeans>& one : means_) one.visit(io);
    }

  private:
    void lift(float mean, int level) {
        Newest<kMeans>& to = means_[level];
        if (to.full()) {
            const float older = to.pop(kGroup);
            if (level + 1 < kLevels) lift(older, level + 1);
        }
        to.push(mean);
    }

    Newest<kSingle> single_;
    Newest<kMeans> means_[kLevels];
};

}  // namespace track
}  // namespace fltea
