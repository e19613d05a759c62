// The spectrum of a stream in constant memory: octaves of Welch's sums, and the whole stream at a lower rate.
//
// Level 0 is the stream, level l + 1 is level l through a half-band filter, every second sample kept. A level
// keeps its samples while they fit (whole_stream.hpp); then they become Welch's sums, and the next level
// keeps its own. So up to Kind::kCapacity samples all of the record is there, and afterwards all of its
// lowest frequencies.
#pragma once

#include <cstdint>

#include "instruction_set.hpp"
#include "welch_level.hpp"
#include "whole_stream.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// After Kind::kLevels the oldest samples of the last level go.
template <typename Kind>
class OctaveLadder {
    typedef typename Kind::Value Value;
    typedef typename Kind::Memory Memory;
    typedef typename Kind::Unit Unit;
    typedef typename Kind::Real Real;

  public:
    typedef typename Kind::Input Input;
    enum { kLevels = Kind::kLevels, kTopLines = 83, kLines = 45, kMostAtOnce = 128 };
    typedef WelchLevel<Kind, kTopLines> Top;  // up to Nyquist's frequency
    typedef WelchLevel<Kind, kLines> Deep;
    typedef WholeStream<Kind> Whole;

    explicit OctaveLadder(Memory memory = Memory(), Unit unit = Unit())
        : memory_(memory), unit_(unit), depth_(0), started_(0), origin_(0), top_(memory, 1) {
        for (int l = 1; l < kLevels; ++l) deep_[l - 1] = Deep(memory, step(l));
    }

    // Of the level that is whole.
    int depth() const { return depth_; }
    const Whole& whole() const { return whole_; }
    static std::uint64_t step(int level) { return std::uint64_t(1) << level; }
    Unit unit() const { return unit_; }
    const typename Kind::Cells& cells(int level) const {
        return level == 0 ? top_.cells() : deep_[level - 1].cells();
    }
    static int lines(int level) { return level == 0 ? int(kTopLines) : int(kLines); }

    // Sums of a level above the whole one, as they stand at sample number `now`, in the squared unit of that
    // level's values. effective: as many blocks of equal weight say as much.
    void sums(int level, std::uint64_t now, Real* power, Real* blocks, Real* effective) const {
        if (level == 0) {
            top_.sums().read(memory_.part(now), power, blocks, effective);
        } else {
            deep_[level - 1].sums().read(memory_.part(now), power, blocks, effective);
        }
    }

    // n <= kMostAtOnce samples that follow those before; made_up: the last place of one that was not
    // measured, or -1 (places: those of all, to keep in mind while the level is whole).
    void accept(const Input* y, int n, std::uint64_t first, const unsigned char* made_up) {
        if (!started_) {
            origin_ = y[0];
            started_ = 1;
        }
        Value batch[kMostAtOnce];
        int last_made_up = -1;
        for (int i = 0; i < n; ++i) {
            batch[i] = unit_.value(y[i], origin_);
            if (made_up[i]) last_made_up = i;
        }
        for (int l = 0; l < depth_ && n > 0; ++l) {
            n = push(l, batch, n, &first, last_made_up);
            last_made_up = -1;
        }
        if (n == 0) return;
        while (whole_.size() + n > Whole::kCapacity) {
            forget(first);
            if (whole_.size() + n <= Whole::kCapacity) break;
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
        if (!memory_.fades()) return;
        forget(now);
        top_.sums().age(memory_.generation(now));
        for (int l = 1; l < depth_; ++l) deep_[l - 1].sums().age(memory_.generation(now));
    }

    // The level that is whole becomes sums. Possible while depth() < kLevels - 1.
    void deepen() {
        // In place: no more comes out than has gone in.
        const typename Whole::Table old = whole_.table();
        whole_.clear();
        const int level = depth_++;
        int begin = 0;
        for (int i = 0; i < old.stretches; ++i) {
            const Stretch& one = old.stretch[i];
            cut_level(level);
            for (int at = 0; at < one.length; at += kMostAtOnce) {
                Value batch[kMostAtOnce];
                int n = one.length - at < kMostAtOnce ? one.length - at : int(kMostAtOnce);
                for (int k = 0; k < n; ++k) batch[k] = Value(whole_.values()[begin + at + k]);
                std::uint64_t first = one.first + std::uint64_t(at) * step(level);
                n = push(level, batch, n, &first,
                         level == 0 ? old.last_made_up(begin + at, begin + at + n) : -1);
                whole_.add(batch, n, first);
            }
            begin += one.length;
            if (!old.open || i + 1 < old.stretches) {
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
        while (whole_.size() + other.whole_.size() > Whole::kCapacity && depth_ < kLevels - 1) {
            deepen();
            other.deepen();
        }
        if (whole_.size() + other.whole_.size() > Whole::kCapacity) drop_oldest(other.whole_.size());
        if (depth_ > 0) top_.merge(other.top_, shift);
        for (int l = 1; l < depth_; ++l) deep_[l - 1].merge(other.deep_[l - 1], shift);
        whole_.append(other.whole_, shift);
        if (!memory_.fades()) return;
        top_.sums().set_generation(memory_.generation(now));
        for (int l = 1; l < depth_; ++l) deep_[l - 1].sums().set_generation(memory_.generation(now));
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(depth_, 0, kLevels - 1);
        io.number(started_, 0, 1);
        io.real(origin_, -1e100, 1e100);
        if (!io.sound()) return;
        if (depth_ > 0) top_.visit(io);
        for (int l = 1; l < depth_ && io.sound(); ++l) deep_[l - 1].visit(io);
        if (io.sound()) whole_.visit(io, 2 * Kind::kLargest);
    }

  private:
    // In place: the batch becomes that of the next level.
    int push(int level, Value* batch, int n, std::uint64_t* first, int made_up) {
        Value next[kMostAtOnce];
        const int outputs =
            level == 0 ? top_.push(batch, n, *first, made_up, level, memory_, next, first)
                       : deep_[level - 1].push(batch, n, *first, made_up, level, memory_, next, first);
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
        if (memory_.fades()) whole_.drop_before(memory_.oldest(now), step(depth_));
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

    Memory memory_;
    Unit unit_;
    int depth_, started_;
    Input origin_;
    Top top_;
    Deep deep_[kLevels - 1];
    Whole whole_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
