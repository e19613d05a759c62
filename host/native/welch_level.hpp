// One octave of the running spectrum: Welch's sums over a stream, and the stream of half its rate.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "block_fft.hpp"
#include "half_band.hpp"
#include "time_cells.hpp"

namespace fltea {

// Sums of |FFT|^2 over blocks that overlap by half, over the lines kLowest ... kLowest + kLines - 1 of 128.
//
// To forget, time is cut into generations of one memory. Sums are those of this generation and of the one
// before, whose weight goes from 1 to 0 while this one grows: what is older than two memories is gone, and
// nothing jumps.
template <typename Number, int kLines>
class WelchLevel {
  public:
    typedef BlockFft<Number> Fft;
    enum { kLowest = 45, kBlock = Fft::kBlock, kHop = kBlock / 2, kMostAtOnce = 128 };

    struct Sums {
        double power[kLines];
        double blocks;
    };

    // memory: in samples of the whole, 0 to forget nothing; step: such samples between two of this level.
    WelchLevel(double memory = 0, double step = 1) : cells_(cell_span(memory, step)), generation_(0) {
        std::memset(&now_, 0, sizeof now_);
        std::memset(&before_, 0, sizeof before_);
        cut();
    }

    // The stream has a break here.
    void cut() {
        fill_ = 0;
        made_up_ = -1;
        begin_ = 0;
    }

    // Takes up to kMostAtOnce values; `first` is the sample number of the first one, `made_up` the place of
    // the last one that was not measured, or -1. Writes the values of the next level, and the first one's
    // sample number; returns how many there are.
    int push(const Number* in, int n, std::uint64_t first, int made_up, std::uint64_t step, double memory,
             Number* out, std::uint64_t* first_out) {
        int outputs = 0;
        for (int taken = 0; taken < n;) {
            const int from = fill_, part = n - taken < kBlock - from ? n - taken : kBlock - from;
            if (from == 0) begin_ = first;
            for (int i = 0; i < part; ++i) x_[from + i] = float(in[taken + i]);
            if (made_up >= taken && made_up < taken + part) made_up_ = from + made_up - taken;
            fill_ = from + part;
            const int more = HalfBand<Number>::run(x_, from, fill_, out + outputs);
            if (more > 0 && outputs == 0) {
                const int middle = HalfBand<Number>::first_place(from) - HalfBand<Number>::kDelay;
                *first_out = begin_ + std::uint64_t(middle) * step;
            }
            outputs += more;
            taken += part;
            if (fill_ == kBlock) end_block(step, memory);
        }
        return outputs;
    }

    // Time goes on to a generation, forwards only.
    void age(double generation) {
        if (!(generation > generation_)) return;
        if (generation == generation_ + 1) {
            before_ = now_;
        } else {
            std::memset(&before_, 0, sizeof before_);
        }
        std::memset(&now_, 0, sizeof now_);
        generation_ = generation;
    }

    // Sums at a time `part` of the way through the generation. effective: as many blocks of equal weight say
    // as much.
    void sums(double part, double* power, double* blocks, double* effective) const {
        const double old = 1 - part;
        for (int i = 0; i < kLines; ++i) power[i] = now_.power[i] + old * before_.power[i];
        *blocks = now_.blocks + old * before_.blocks;
        const double squares = now_.blocks + old * old * before_.blocks;
        *effective = squares > 0 ? *blocks * *blocks / squares : 0;
    }

    const TimeCells& cells() const { return cells_; }

    // Of a later stretch. Both have come to the same generation as far as their own clocks go.
    void merge(const WelchLevel& other, std::uint64_t shift) {
        add(now_, other.now_);
        add(before_, other.before_);
        cells_.merge(other.cells_, shift);
    }
    // Where its clock stands after a merge: no longer that of its own samples.
    void set_generation(double generation) { generation_ = generation; }

    template <typename Io>
    void visit(Io& io) {
        io.number(fill_, 0, kBlock - 1);
        io.number(made_up_, -1, kBlock - 1);
        io.number(begin_, 0, 1e15);
        io.number(generation_, 0, 1e15);
        for (int i = 0; i < fill_ && io.sound(); ++i) io.real(x_[i], -kLargest, kLargest);
        visit(io, now_);
        visit(io, before_);
        cells_.visit(io);
    }

    // Of the values that come.
    static constexpr double kLargest = 1e19;

  private:
    static std::uint32_t cell_span(double memory, double step) {
        if (!(memory > 0)) return 0;
        const double span = std::ceil(2 * memory / (step * kHop * (TimeCells::kMost - 1)));
        return span < 1e9 ? std::uint32_t(span < 1 ? 1 : span) : 1000000000u;
    }

    static void add(Sums& to, const Sums& more) {
        for (int i = 0; i < kLines; ++i) to.power[i] += more.power[i];
        to.blocks += more.blocks;
    }

    template <typename Io>
    static void visit(Io& io, Sums& sums) {
        io.number(sums.blocks, 0, 1e15);
        for (int i = 0; i < kLines && io.sound(); ++i) io.real(sums.power[i], 0, 1e60);
    }

    void end_block(std::uint64_t step, double memory) {
        if (made_up_ < 0) {
            Number power[kLines];
            Fft::shared().power(x_, kLowest, kLines, power);
            const double born = memory > 0 ? std::floor(double(begin_ + kBlock * step) / memory) : 0;
            age(born);
            if (born >= generation_ - 1) {
                Sums& to = born == generation_ ? now_ : before_;
                for (int i = 0; i < kLines; ++i) to.power[i] += double(power[i]);
                to.blocks += 1;
            }
            double sum = 0;
            for (int i = 0; i < kLines; ++i) sum += double(power[i]);
            if (sum > 0) cells_.add(begin_, float(std::log(sum / (kLines * Fft::scale()))));
        }
        std::memmove(x_, x_ + kHop, kHop * sizeof x_[0]);
        fill_ = kHop;
        begin_ += kHop * step;
        made_up_ = made_up_ < kHop ? -1 : made_up_ - kHop;
    }

    float x_[kBlock];
    int fill_, made_up_;   // values of x_; the place of the last one that was not measured, or -1
    std::uint64_t begin_;  // sample number of the first one
    Sums now_, before_;
    TimeCells cells_;
    double generation_;
};

template <typename Number, int kLines>
constexpr double WelchLevel<Number, kLines>::kLargest;

}  // namespace fltea
