// The last stretches of a stream, sample by sample, as long as they are few.
#pragma once

#include <cstdint>
#include <cstring>

namespace fltea {

// A run of samples without a break.
struct Stretch {
    std::uint64_t first;  // sample number of the first
    int length;
};

// Samples of all stretches stand one behind the other. A closed stretch of fewer than kShortest is dropped:
// nothing is read from it, here or at half the rate.
class WholeStream {
  public:
    enum { kCapacity = 3072, kShortest = 64, kMostStretches = kCapacity / kShortest + 1, kMostMadeUp = 64 };

    WholeStream() : size_(0), stretches_(0), open_(0), made_up_(0) {}

    int size() const { return size_; }
    const float* values() const { return x_; }
    int stretches() const { return stretches_; }
    const Stretch& stretch(int i) const { return stretch_[i]; }
    // The last stretch goes on.
    bool open() const { return open_ != 0; }
    // The place of the last value in [from, to) that was not measured, less from; or -1.
    int made_up(int from, int to) const {
        int last = -1;
        for (int i = 0; i < made_up_; ++i) {
            if (place_[i] >= from && place_[i] < to && place_[i] - from > last) last = place_[i] - from;
        }
        return last;
    }

    void clear() { size_ = stretches_ = open_ = made_up_ = 0; }

    // There is room for them.
    template <typename Number>
    void add(const Number* values, int n, std::uint64_t first) {
        if (n == 0) return;
        if (!open_) {
            stretch_[stretches_].first = first;
            stretch_[stretches_].length = 0;
            ++stretches_;
            open_ = 1;
        }
        for (int i = 0; i < n; ++i) x_[size_ + i] = float(values[i]);
        size_ += n;
        stretch_[stretches_ - 1].length += n;
    }

    void note_made_up(int place) {
        if (made_up_ == kMostMadeUp) {
            std::memmove(place_, place_ + 1, (kMostMadeUp - 1) * sizeof place_[0]);
            --made_up_;
        }
        place_[made_up_++] = place;
    }

    void cut() {
        if (!open_) return;
        open_ = 0;
        if (stretch_[stretches_ - 1].length >= kShortest) return;
        size_ -= stretch_[--stretches_].length;
        while (made_up_ > 0 && place_[made_up_ - 1] >= size_) --made_up_;
    }

    // Samples with numbers below `least` go, of which each stands for `step`, and stretches that are too
    // short then.
    void drop_before(std::uint64_t least, std::uint64_t step) {
        int gone = 0, dropped = 0;
        while (dropped < stretches_ && stretch_[dropped].first < least) {
            Stretch& one = stretch_[dropped];
            const std::uint64_t late = (least - one.first + step - 1) / step;
            const int old = late < std::uint64_t(one.length) ? int(late) : one.length;
            const bool last = open_ && dropped == stretches_ - 1;
            if (one.length - old < kShortest && !last) {
                gone += one.length;
                ++dropped;
                continue;
            }
            one.first += std::uint64_t(old) * step;
            one.length -= old;
            gone += old;
            break;
        }
        if (gone == 0) return;
        std::memmove(x_, x_ + gone, std::size_t(size_ - gone) * sizeof x_[0]);
        for (int i = dropped; i < stretches_; ++i) stretch_[i - dropped] = stretch_[i];
        size_ -= gone;
        stretches_ -= dropped;
        int kept = 0;
        for (int i = 0; i < made_up_; ++i) {
            if (place_[i] >= gone) place_[kept++] = place_[i] - gone;
        }
        made_up_ = kept;
    }

    // All of another one behind this one, both with a break at the end; there is room for it.
    void append(const WholeStream& other, std::uint64_t shift) {
        for (int i = 0; i < other.made_up_; ++i) note_made_up(size_ + other.place_[i]);
        const float* from = other.x_;
        for (int i = 0; i < other.stretches_; ++i) {
            add(from, other.stretch_[i].length, other.stretch_[i].first + shift);
            from += other.stretch_[i].length;
            open_ = 0;
        }
    }

    template <typename Io>
    void visit(Io& io, double largest) {
        io.number(size_, 0, kCapacity);
        io.number(stretches_, 0, kMostStretches);
        io.number(open_, 0, stretches_ > 0 ? 1 : 0);
        io.number(made_up_, 0, kMostMadeUp);
        int sum = 0;
        for (int i = 0; i < stretches_ && io.sound(); ++i) {
            const bool last = open_ && i == stretches_ - 1;
            io.number(stretch_[i].first, 0, 1e15);
            io.number(stretch_[i].length, last ? 0 : int(kShortest), kCapacity);
            sum += stretch_[i].length;
        }
        io.require(sum == size_);
        for (int i = 0; i < made_up_ && io.sound(); ++i) {
            io.number(place_[i], i > 0 ? place_[i - 1] : 0, size_ - 1);
        }
        for (int i = 0; i < size_ && io.sound(); ++i) io.real(x_[i], -largest, largest);
    }

  private:
    float x_[kCapacity];
    int size_;
    Stretch stretch_[kMostStretches];
    int stretches_, open_;
    int place_[kMostMadeUp], made_up_;
};

}  // namespace fltea
