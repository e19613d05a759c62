// The spectrum of a stream in constant memory: octaves of Welch's sums, and the whole stream at a lower rate.
//
// Level 0 is the stream, level l + 1 is level l through a half-band filter, every second sample kept. A level
// keeps its samples while they fit (whole_stream.hpp); then they become Welch's sums, and the next level
// keeps its own. So up to 3,072 samples all of the record is there, and afterwards all of its lowest
// frequencies.
#pragma once

#include <cmath>
#include <cstdint>

#include "welch_level.hpp"
#include "whole_stream.hpp"

namespace fltea {

// kMostLevels: 20 are half a year at 100 Hz; after that the oldest samples of the last level go.
template <typename Number, int kMostLevels = 20>
class OctaveLadder {
  public:
    enum { kLevels = kMostLevels, kTopLines = 83, kLines = 45, kMostAtOnce = 128 };
    typedef WelchLevel<Number, kTopLines> Top;  // up to Nyquist's frequency
    typedef WelchLevel<Number, kLines> Deep;

    explicit OctaveLadder(double memory = 0)
        : memory_(memory), depth_(0), started_(0), origin_(0), top_(memory, 1) {
        for (int l = 1; l < kLevels; ++l) deep_[l - 1] = Deep(memory, double(step(l)));
    }

    // Of the level that is whole.
    int depth() const { return depth_; }
    const WholeStream& whole() const { return whole_; }
    static std::uint64_t step(int level) { return std::uint64_t(1) << level; }
    const TimeCells& cells(int level) const { return level == 0 ? top_.cells() : deep_[level - 1].cells(); }
    static int lines(int level) { return level == 0 ? int(kTopLines) : int(kLines); }

    // Sums of a level above the whole one (welch_level.hpp), as they stand at sample number `now`.
    void sums(int level, std::uint64_t now, double* power, double* blocks, double* effective) const {
        const double part = memory_ > 0 ? double(now) / memory_ - generation(now) : 0;
        if (level == 0) {
            top_.sums(part, power, blocks, effective);
        } else {
            deep_[level - 1].sums(part, power, blocks, effective);
        }
    }

    // n <= kMostAtOnce samples that follow those before; made_up: the last place of one that was not
    // measured, or -1 (places: those of all, to keep in mind while the level is whole).
    void accept(const double* y, int n, std::uint64_t first, const unsigned char* made_up) {
        if (!started_) {
            origin_ = y[0];
            started_ = 1;
        }
        Number batch[kMostAtOnce];
        const double largest = Top::kLargest;
        int last_made_up = -1;
        for (int i = 0; i < n; ++i) {
            const double value = y[i] - origin_;
            // What no sensor says must not become infinite.
            batch[i] = Number(value > largest ? largest : value < -largest ? -largest : value);
            if (made_up[i]) last_made_up = i;
        }
        for (int l = 0; l < depth_ && n > 0; ++l) {
            n = push(l, batch, n, &first, last_made_up);
            last_made_up = -1;
        }
        if (n == 0) return;
        while (whole_.size() + n > WholeStream::kCapacity) {
            if (memory_ > 0) forget(first);
            if (whole_.size() + n <= WholeStream::kCapacity) break;
            if (depth_ == kLevels - 1) {
                drop_oldest(n);
                break;
            }
            deepen();
            n = push(depth_ - 1, batch, n, &first, depth_ == 1 ? last_made_up : -1);
        }
        if (depth_ == 0) {
            for (int i = 0; i < n; ++i) {
                if (made_up[i]) whole_.note_made_up(whole_.size() + i);
            }
        }
        whole_.add(batch, n, first);
    }

    // The stream has a break here; what comes has an offset of its own.
    void cut() {
        started_ = 0;
        top_.cut();
        for (int l = 1; l < depth_; ++l) deep_[l - 1].cut();
        whole_.cut();
    }

    // Time has come to sample number `now`.
    void age(std::uint64_t now) {
        if (!(memory_ > 0)) return;
        forget(now);
        top_.age(generation(now));
        for (int l = 1; l < depth_; ++l) deep_[l - 1].age(generation(now));
    }

    // The level that is whole becomes sums. Possible while depth() < kLevels - 1.
    void deepen() {
        const WholeStream old = whole_;
        whole_.clear();
        const int level = depth_++;
        int begin = 0;
        for (int i = 0; i < old.stretches(); ++i) {
            const Stretch& one = old.stretch(i);
            cut_level(level);
            for (int at = 0; at < one.length; at += kMostAtOnce) {
                Number batch[kMostAtOnce];
                int n = one.length - at < kMostAtOnce ? one.length - at : int(kMostAtOnce);
                for (int k = 0; k < n; ++k) batch[k] = Number(old.values()[begin + at + k]);
                std::uint64_t first = one.first + std::uint64_t(at) * step(level);
                n = push(level, batch, n, &first, level == 0 ? old.made_up(begin + at, begin + at + n) : -1);
                whole_.add(batch, n, first);
            }
            begin += one.length;
            if (!old.open() || i + 1 < old.stretches()) {
                whole_.cut();
                cut_level(level);
            }
        }
    }

    // Of a later stretch, whose sample 0 is our sample `shift`; it ends at our sample `now`. Both have had a
    // break and have been aged.
    void merge(OctaveLadder other, std::uint64_t shift, std::uint64_t now) {
        age(now);
        while (depth_ < other.depth_ && depth_ < kLevels - 1) deepen();
        while (other.depth_ < depth_ && other.depth_ < kLevels - 1) other.deepen();
        while (whole_.size() + other.whole_.size() > WholeStream::kCapacity && depth_ < kLevels - 1) {
            deepen();
            other.deepen();
        }
        if (whole_.size() + other.whole_.size() > WholeStream::kCapacity) drop_oldest(other.whole_.size());
        if (depth_ > 0) top_.merge(other.top_, shift);
        for (int l = 1; l < depth_; ++l) deep_[l - 1].merge(other.deep_[l - 1], shift);
        whole_.append(other.whole_, shift);
        if (!(memory_ > 0)) return;
        top_.set_generation(generation(now));
        for (int l = 1; l < depth_; ++l) deep_[l - 1].set_generation(generation(now));
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(depth_, 0, kLevels - 1);
        io.number(started_, 0, 1);
        io.real(origin_, -1e100, 1e100);
        if (!io.sound()) return;
        if (depth_ > 0) top_.visit(io);
        for (int l = 1; l < depth_ && io.sound(); ++l) deep_[l - 1].visit(io);
        if (io.sound()) whole_.visit(io, 2 * Top::kLargest);
    }

  private:
    double generation(std::uint64_t sample) const {
        return memory_ > 0 ? std::floor(double(sample) / memory_) : 0;
    }

    // In place: the batch becomes that of the next level.
    int push(int level, Number* batch, int n, std::uint64_t* first, int made_up) {
        Number next[kMostAtOnce];
        const int outputs =
            level == 0 ? top_.push(batch, n, *first, made_up, 1, memory_, next, first)
                       : deep_[level - 1].push(batch, n, *first, made_up, step(level), memory_, next, first);
        for (int i = 0; i < outputs; ++i) batch[i] = next[i];
        return outputs;
    }

    void cut_level(int level) {
        if (level == 0) {
            top_.cut();
        } else {
            deep_[level - 1].cut();
        }
    }

    // Of the whole level: what is older than two memories.
    void forget(std::uint64_t now) {
        const double least = double(now) - 2 * memory_;
        if (least > 0) whole_.drop_before(std::uint64_t(std::ceil(least)), step(depth_));
    }

    // At least n of the whole level.
    void drop_oldest(int n) {
        int left = n;
        for (int i = 0; i < whole_.stretches() && left > 0; ++i) {
            const Stretch one = whole_.stretch(i);
            const int part = left < one.length ? left : one.length;
            if (left <= one.length) {
                whole_.drop_before(one.first + std::uint64_t(part) * step(depth_), step(depth_));
                return;
            }
            left -= part;
        }
    }

    double memory_;
    int depth_, started_;
    double origin_;
    Top top_;
    Deep deep_[kLevels - 1];
    WholeStream whole_;
};

}  // namespace fltea
