// Stores the samples of a stream's newest stretches, as long as they fit. A stretch is a run of samples
// without a break.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// A run of samples without a break.
struct Stretch {
    std::uint64_t first;  // sample number of the first sample
    int length;
};

// The samples of all stretches are stored one after another. When a stretch ends and is shorter than
// kShortest, it is dropped, because no spectrum can be computed from it, neither at this rate nor at half the
// rate.
template <typename Kind>
class WholeStream {
    typedef typename Kind::Kept Kept;

  public:
    enum {
        kCapacity = Kind::kCapacity,
        kShortest = 64,
        kMostStretches = kCapacity / kShortest + 1,
        kMostMadeUp = Kind::kMostMadeUp
    };

    // Where each stretch (a run of samples without a break) begins and how long it is, and which of the
    // stored values were filled in because they were not measured.
    struct Table {
        Stretch stretch[kMostStretches];
        int stretches, open;  // `open`: 1 if the last stretch has not ended
        int place[kMostMadeUp], made_up;

        // Finds the last filled-in value (one that was not measured) with an index from `from` to below `to`.
        // Returns its index minus `from`, or -1 if there is none.
        int last_made_up(int from, int to) const {
            int last = -1;
            for (int i = 0; i < made_up; ++i) {
                if (place[i] >= from && place[i] < to && place[i] - from > last) last = place[i] - from;
            }
            return last;
        }
    };

    WholeStream() : size_(0) { clear(); }

    int size() const { return size_; }
    const Kept* values() const { return x_; }
    int stretches() const { return table_.stretches; }
    const Stretch& stretch(int i) const { return table_.stretch[i]; }
    const Table& table() const { return table_; }

    void clear() { size_ = table_.stretches = table_.open = table_.made_up = 0; }

    // Adds n values, for which there has to be room.
    template <typename Number>
    void add(const Number* values, int n, std::uint64_t first) {
        if (n == 0) return;
        if (!table_.open) {
            table_.stretch[table_.stretches].first = first;
            table_.stretch[table_.stretches].length = 0;
            ++table_.stretches;
            table_.open = 1;
        }
        for (int i = 0; i < n; ++i) x_[size_ + i] = Kept(values[i]);
        size_ += n;
        table_.stretch[table_.stretches - 1].length += n;
    }

    void note_made_up(int place) {
        if (table_.made_up == kMostMadeUp) {
            std::memmove(table_.place, table_.place + 1, (kMostMadeUp - 1) * sizeof table_.place[0]);
            --table_.made_up;
        }
        table_.place[table_.made_up++] = place;
    }

    void cut() {
        if (!table_.open) return;
        table_.open = 0;
        if (table_.stretch[table_.stretches - 1].length >= kShortest) return;
        size_ -= table_.stretch[--table_.stretches].length;
        while (table_.made_up > 0 && table_.place[table_.made_up - 1] >= size_) --table_.made_up;
    }

    // Drops all samples with a sample number below `least`. `step`: difference between the numbers of
    // neighbouring samples, which is not 1 at a lower rate. If a stretch has ended and fewer than kShortest
    // of its samples would be left, they are dropped, too.
    void drop_before(std::uint64_t least, std::uint64_t step) {
        int gone = 0, dropped = 0;
        while (dropped < table_.stretches && table_.stretch[dropped].first < least) {
            Stretch& one = table_.stretch[dropped];
            const std::uint64_t late = (least - one.first + step - 1) / step;
            const int old = late < std::uint64_t(one.length) ? int(late) : one.length;
            const bool last = table_.open && dropped == table_.stretches - 1;
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
        for (int i = dropped; i < table_.stretches; ++i) table_.stretch[i - dropped] = table_.stretch[i];
        size_ -= gone;
        table_.stretches -= dropped;
        int kept = 0;
        for (int i = 0; i < table_.made_up; ++i) {
            if (table_.place[i] >= gone) table_.place[kept++] = table_.place[i] - gone;
        }
        table_.made_up = kept;
    }

    // Appends all stretches of another stream. Both streams need to end with a break, and there has to be
    // room for the samples.
    void append(const WholeStream& other, std::uint64_t shift) {
        for (int i = 0; i < other.table_.made_up; ++i) note_made_up(size_ + other.table_.place[i]);
        const Kept* from = other.x_;
        for (int i = 0; i < other.table_.stretches; ++i) {
            add(from, other.table_.stretch[i].length, other.table_.stretch[i].first + shift);
            from += other.table_.stretch[i].length;
            table_.open = 0;
        }
    }

    template <typename Io>
    void visit(Io& io, double largest) {
        io.number(size_, 0, kCapacity);
        io.number(table_.stretches, 0, kMostStretches);
        io.number(table_.open, 0, table_.stretches > 0 ? 1 : 0);
        io.number(table_.made_up, 0, kMostMadeUp);
        int sum = 0;
        for (int i = 0; i < table_.stretches && io.sound(); ++i) {
            const bool last = table_.open && i == table_.stretches - 1;
            io.number(table_.stretch[i].first, 0, 1e15);
            io.number(table_.stretch[i].length, last ? 0 : int(kShortest), kCapacity);
            sum += table_.stretch[i].length;
        }
        io.require(sum == size_);
        for (int i = 0; i < table_.made_up && io.sound(); ++i) {
            io.number(table_.place[i], i > 0 ? table_.place[i - 1] : 0, size_ - 1);
        }
        for (int i = 0; i < size_ && io.sound(); ++i) io.real(x_[i], -largest, largest);
    }

  private:
    Kept x_[kCapacity];
    int size_;
    Table table_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
