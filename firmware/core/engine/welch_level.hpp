// One octave of the running spectrum: sums of periodograms over overlapping blocks (Welch's method), and the
// stream at half the rate for the next octave.
#pragma once

#include <cstdint>
#include <cstring>

#include "block_fft.hpp"
#include "half_band.hpp"
#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// Sums |FFT|^2 over blocks of 256 values that overlap by half. Of the 128 frequencies, only those with the
// indices kLowest ... kLowest + kLines - 1 are summed.
template <typename Kind, int kLines>
class WelchLevel {
    typedef typename Kind::Value Value;
    typedef typename Kind::Stored Stored;
    typedef typename Kind::Memory Memory;

  public:
    typedef BlockFft<Kind> Fft;
    typedef typename Kind::template Sums<kLines> Sums;
    typedef typename Kind::template Cells<kLines> Cells;
    enum { kLowest = 45, kBlock = Fft::kBlock, kHop = kBlock / 2, kMostAtOnce = 128 };

    // `step`: number of samples of the original stream per value of this level.
    explicit WelchLevel(Memory memory = Memory(), std::uint64_t step = 1)
        : x_(), cells_(memory, step * kHop) {
        cut();
    }

    // Notes a break of the stream: no block contains values from before and after the break.
    void cut() {
        fill_ = 0;
        made_up_ = -1;
        begin_ = 0;
        base_ = typename Kind::Base();
    }

    // Adds the `n` values in `in`, at most kMostAtOnce. `first`: sample number of the first value; `made_up`:
    // index of the last value that was not measured, or -1. The next level has half this level's rate. Writes
    // its new values to `out`, and the sample number of the first of them to `first_out`. Returns the number
    // of values written.
    int push(const Value* in, int n, std::uint64_t first, int made_up, int level, Memory memory, Value* out,
             std::uint64_t* first_out) {
        const std::uint64_t step = std::uint64_t(1) << level;
        int outputs = 0;
        for (int taken = 0; taken < n;) {
            const int from = fill_, part = n - taken < kBlock - from ? n - taken : kBlock - from;
            if (from == 0) begin_ = first;
            base_.store(in + taken, part, x_, from);
            if (made_up >= taken && made_up < taken + part) made_up_ = from + made_up - taken;
            fill_ = from + part;
            const int more = HalfBand<Kind>::run(x_, from, fill_, level, out + outputs);
            base_.lift(out + outputs, more, level);
            if (more > 0 && outputs == 0) {
                const int middle = HalfBand<Kind>::first_place(from) - HalfBand<Kind>::kDelay;
                *first_out = begin_ + std::uint64_t(middle) * step;
            }
            outputs += more;
            taken += part;
            if (fill_ == kBlock) end_block(step, memory);
        }
        return outputs;
    }

    // Sets memory and step as the constructor does. Call this before the first value is added.
    void begin(Memory memory, std::uint64_t step) { cells_ = Cells(memory, step * kHop); }

    Sums& sums() { return sums_; }
    const Sums& sums() const { return sums_; }
    const Cells& cells() const { return cells_; }

    // Merges the sums of a later part of the stream. Before this, call age() on both sums with the same
    // generation (fading_sums.hpp), so that both have forgotten the same samples.
    void merge(const WelchLevel& other, std::uint64_t shift) {
        sums_.merge(other.sums_);
        cells_.merge(other.cells_, shift);
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(fill_, 0, kBlock - 1);
        io.number(made_up_, -1, kBlock - 1);
        io.number(begin_, 0, 1e15);
        sums_.visit_clock(io);
        for (int i = 0; i < fill_ && io.sound(); ++i) io.real(x_[i], -Kind::kLargest, Kind::kLargest);
        sums_.visit(io);
        cells_.visit(io);
    }

  private:
    // This function is not inlined into push(). Otherwise the stack would hold the local variables of the FFT
    // and those of the half-band filter at the same time.
    __attribute__((noinline)) void end_block(std::uint64_t step, Memory memory) {
        if (made_up_ < 0) {
            typename Fft::Work work;
            const typename Fft::Powers found = Fft::powers(x_, kLowest, kLines, work);
            sums_.add(found.power, found.places - base_.shift(), memory.generation(begin_ + kBlock * step));
            cells_.note(begin_, found.power, int(kLines), Fft::scale());
        }
        std::memmove(x_, x_ + kHop, kHop * sizeof x_[0]);
        fill_ = kHop;
        base_.renew(x_, fill_);
        begin_ += kHop * step;
        made_up_ = made_up_ < kHop ? -1 : made_up_ - kHop;
    }

    Stored x_[kBlock];
    typename Kind::Base base_;
    int fill_, made_up_;   // number of values in x_; index of the last one that was not measured, or -1
    std::uint64_t begin_;  // sample number of the first value in x_
    Sums sums_;
    Cells cells_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
