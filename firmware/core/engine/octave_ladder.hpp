// The spectrum of a stream of samples in constant memory: Welch sums (summed periodograms of overlapping
// blocks), one octave per level, and all samples of the stream at a reduced rate.
//
// Level 0 is the stream. Level l + 1 is level l after a half-band filter, with every second sample kept. One
// level keeps its samples (whole_stream.hpp), at first level 0. When these samples no longer fit, they are
// turned into Welch sums, and the next level keeps its own samples instead. A record of up to Kind::kCapacity
// samples is therefore available unchanged. A longer record is available at a reduced rate, which keeps its
// lowest frequencies.
#pragma once

#include <cstdint>

#include "instruction_set.hpp"
#include "welch_level.hpp"
#include "whole_stream.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The running spectrum. When all Kind::kLevels levels are used, the last level drops its oldest samples.
template <typename Kind>
class OctaveLadder {
    typedef typename Kind::Value Value;
    typedef typename Kind::Memory Memory;
    typedef typename Kind::Real Real;

  public:
    typedef typename Kind::Input Input;
    enum { kLevels = Kind::kLevels, kTopLines = 83, kLines = 45, kMostAtOnce = 128 };
    typedef WelchLevel<Kind, kTopLines> Top;  // level 0; its frequencies reach up to the Nyquist frequency
    typedef WelchLevel<Kind, kLines> Deep;
    typedef WholeStream<Kind> Whole;

    explicit OctaveLadder(Memory memory = Memory())
        : memory_(memory), depth_(0), started_(0), origin_(0), top_(memory, 1) {
        for (int l = 1; l < kLevels - 1; ++l) deep_[l - 1].begin(memory, step(l));
    }

    // Returns the number of the level whose samples are kept. All levels with lower numbers have Welch sums.
    int depth() const { return depth_; }
    const Whole& whole() const { return whole_; }
    static std::uint64_t step(int level) { return std::uint64_t(1) << level; }
    const typename Top::Cells& top_cells() const { return top_.cells(); }
    // Returns what is recorded of the spectrum over time (time_cells.hpp) for a level other than level 0.
    const typename Deep::Cells& cells(int level) const { return deep_[level - 1].cells(); }
    static int lines(int level) { return level == 0 ? int(kTopLines) : int(kLines); }

    // Reads the Welch sums of a level at sample number `now`, in the squared unit of that level's values.
    // `effective`: number of blocks of equal weight that would give the same precision as the blocks of
    // different weights.
    void sums(int level, std::uint64_t now, Real* power, Real* blocks, Real* effective) const {
        if (level == 0) {
            top_.sums().read(memory_.part(now), power, blocks, effective);
        } else {
            deep_[level - 1].sums().read(memory_.part(now), power, blocks, effective);
        }
    }

    // One level keeps its samples. When they no longer fit, they are turned into Welch sums; this is how far
    // that has come.
    struct Deepening {
        typename Whole::Table old;
        // `stretch`: index in `old` of the stretch that is being turned into Welch sums. `at`: index of its
        // next sample. `begin`: index of its first sample among all stored samples.
        int stretch, at, begin;
        bool going;
        Deepening() : going(false) {}
    };
    // A batch of samples that advance() takes from level to level.
    struct Passage {
        Deepening deepening;
        Value batch[kMostAtOnce];
        std::uint64_t first;
        int n, level, last_made_up;
        bool cut;  // a break of the stream follows the batch
        Passage() : first(0), n(0), level(0), last_made_up(-1), cut(false) {}
    };

    // Adds n <= kMostAtOnce samples that follow the previous ones; the first of them has the sample number
    // `first`. `made_up`: one flag per sample, set if the sample was not measured. These flags are only
    // stored while level 0 is the level that keeps its samples.
    void accept(const Input* y, int n, std::uint64_t first, const unsigned char* made_up) {
        Passage passage;
        enter(y, n, first, made_up, passage);
        while (!advance(passage)) {
        }
    }

    // Begins to add samples as accept() does, but one level at a time. Call advance() until it returns true,
    // before anything else is added.
    void enter(const Input* y, int n, std::uint64_t first, const unsigned char* made_up, Passage& p) {
        if (!started_) {
            origin_ = y[0];
            started_ = 1;
        }
        p.n = n;
        p.first = first;
        p.level = 0;
        p.last_made_up = -1;
        for (int i = 0; i < n; ++i) {
            p.batch[i] = Kind::value(y[i], origin_);
            if (made_up[i]) p.last_made_up = i;
        }
        if (depth_ > 0 || !fits(p)) return;
        for (int i = 0; i < n; ++i) {
            if (made_up[i]) whole_.note_made_up(whole_.size() + i);
        }
        settle(p);
    }
    // Takes the batch of values in `p` through one level. Returns true when the batch has passed all levels.
    bool advance(Passage& p) {
        if (p.deepening.going) {
            go_deeper(p.deepening);
        } else if (p.n > 0 && p.level < depth_) {
            p.n = push(p.level++, p.batch, p.n, &p.first, p.last_made_up);
            p.last_made_up = -1;
        } else if (p.n > 0) {
            if (!fits(p) && depth_ < kLevels - 1) {
                begin_deepening(p.deepening);
            } else {
                if (!fits(p)) drop_oldest(p.n);
                settle(p);
            }
        }
        if (p.n > 0) return false;
        if (p.cut) cut();
        p.cut = false;
        return true;
    }
    // Notes a break of the stream as cut() does. If a batch is still on its way, the break is noted after
    // that batch.
    void cut_after(Passage& p) {
        if (p.n > 0) {
            p.cut = true;
        } else {
            cut();
        }
    }

    // Notes a break of the stream. The samples after the break are stored relative to another origin, which
    // is the first of them.
    void cut() {
        started_ = 0;
        top_.cut();
        for (int l = 1; l < depth_; ++l) deep_[l - 1].cut();
        whole_.cut();
    }

    // Lets the weight of old blocks in the Welch sums fade, as far as is due at sample number `now`.
    void age(std::uint64_t now) {
        if (!memory_.fades()) return;
        forget(now);
        top_.sums().age(memory_.generation(now));
        for (int l = 1; l < depth_; ++l) deep_[l - 1].sums().age(memory_.generation(now));
    }

    // Turns the samples of the level that keeps its samples, level depth(), into Welch sums. This is only
    // possible while depth() < kLevels - 1.
    void deepen() {
        Deepening d;
        begin_deepening(d);
        while (d.going) go_deeper(d);
    }

    // Merges the spectrum `other` of a later part of the stream. Sample 0 of `other` is sample `shift` of
    // this stream, and `other` ends at sample `now` of this stream. Before the merge, cut() and age() have to
    // be called on both spectra.
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
    // The samples of the next level are written to the same memory from which the old samples are still being
    // read. No unread sample is overwritten, because the output of a level is never longer than its input.
    void begin_deepening(Deepening& d) {
        d.old = whole_.table();
        d.stretch = d.at = d.begin = 0;
        d.going = d.old.stretches > 0;
        whole_.clear();
        ++depth_;
    }
    // Takes one step of turning the stored samples of a level into Welch sums. The next batch of these
    // samples is added to that level's Welch sums. The outputs of its filter, which are samples of the next
    // level (depth_), are stored.
    void go_deeper(Deepening& d) {
        const int level = depth_ - 1;
        const Stretch& one = d.old.stretch[d.stretch];
        if (d.at == 0) cut_level(level);
        const int left = one.length - d.at, from = d.begin + d.at;
        int n = left < kMostAtOnce ? left : int(kMostAtOnce);
        if (n > 0) {
            Value batch[kMostAtOnce];
            for (int k = 0; k < n; ++k) batch[k] = Value(whole_.values()[from + k]);
            std::uint64_t first = one.first + std::uint64_t(d.at) * step(level);
            const int made_up = level == 0 ? d.old.last_made_up(from, from + n) : -1;
            d.at += n;
            n = push(level, batch, n, &first, made_up);
            whole_.add(batch, n, first);
        }
        if (d.at < one.length) return;
        d.begin += one.length;
        d.at = 0;
        d.going = ++d.stretch < d.old.stretches;
        if (!d.old.open || d.going) {
            whole_.cut();
            cut_level(level);
        }
    }

    // Whether the level that keeps its samples has room for the batch of values in `p`.
    bool fits(const Passage& p) {
        if (whole_.size() + p.n > Whole::kCapacity) forget(p.first);
        return whole_.size() + p.n <= Whole::kCapacity;
    }
    void settle(Passage& p) {
        whole_.add(p.batch, p.n, p.first);
        p.n = 0;
    }

    // Adds the batch to the Welch sums of `level`, and replaces it by the values for the next level.
    int push(int level, Value* batch, int n, std::uint64_t* first, int made_up) {
        Value next[kMostAtOnce / 2 + 1];
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

    // In the level that keeps its samples, drops samples that are older than twice the memory length of sums
    // that forget.
    void forget(std::uint64_t now) {
        if (memory_.fades()) whole_.drop_before(memory_.oldest(now), step(depth_));
    }

    // One level, depth(), keeps its samples. Drops the oldest of them, n or a few more.
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
    int depth_, started_;
    Input origin_;
    Top top_;
    // Welch sums of the levels 1 to kLevels - 2; those of level 0 are in top_, and the last level only keeps
    // samples
    Deep deep_[kLevels - 2];
    Whole whole_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
