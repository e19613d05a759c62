// Sums of the powers of Welch blocks in one octave, with optional forgetting of old samples.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

namespace fltea {

// Says how fast sums forget old samples. `samples`: length of the memory [samples]; 0: nothing is forgotten.
//
// For forgetting, time is divided into generations of one memory length. The sums are those of the current
// generation plus those of the previous generation, whose weight falls from 1 to 0 while the current one
// grows. Samples older than two memory lengths are therefore forgotten, and the sums never jump.
class FadingMemory {
  public:
    FadingMemory(double samples = 0) : samples_(samples) {}

    double samples() const { return samples_; }
    bool fades() const { return samples_ > 0; }
    double generation(std::uint64_t sample) const {
        return fades() ? std::floor(double(sample) / samples_) : 0;
    }
    // Returns which fraction of the current generation has passed when sample number `sample` comes; 0 if
    // nothing is forgotten.
    double part(std::uint64_t sample) const {
        return fades() ? double(sample) / samples_ - generation(sample) : 0;
    }
    // Number of the oldest sample that is not forgotten yet when sample number `now` comes.
    std::uint64_t oldest(std::uint64_t now) const {
        const double least = double(now) - 2 * samples_;
        return least > 0 ? std::uint64_t(std::ceil(least)) : 0;
    }

  private:
    double samples_;
};

template <int kLines>
class FadingSums {
  public:
    FadingSums() : generation_(0) {
        std::memset(&now_, 0, sizeof now_);
        std::memset(&before_, 0, sizeof before_);
    }

    // Adds the powers of a block that belongs to the generation number `born` (FadingMemory). The powers have
    // the same unit as the sums, so the second argument, a shift between the two units, is not used.
    template <typename Number>
    void add(const Number* power, int, double born) {
        age(born);
        if (born < generation_ - 1) return;
        Sums& to = born == generation_ ? now_ : before_;
        for (int i = 0; i < kLines; ++i) to.power[i] += double(power[i]);
        to.blocks += 1;
    }

    // Advances to the generation number `generation` (FadingMemory), if it is later than the current one.
    // Forgets the sums of all generations except this one and the one just before it.
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

    // Writes the sums as they are when the fraction `part` of the current generation (FadingMemory) has
    // passed. `power`: weighted sums of the powers. `blocks`: sum of the blocks' weights. `effective`: number
    // of blocks of equal weight that would give the same precision.
    void read(double part, double* power, double* blocks, double* effective) const {
        const double old = 1 - part;
        for (int i = 0; i < kLines; ++i) power[i] = now_.power[i] + old * before_.power[i];
        *blocks = now_.blocks + old * before_.blocks;
        const double squares = now_.blocks + old * old * before_.blocks;
        *effective = squares > 0 ? *blocks * *blocks / squares : 0;
    }

    void merge(const FadingSums& other) {
        add(now_, other.now_);
        add(before_, other.before_);
    }
    // Sets the number of the current generation (FadingMemory). Call this after merge(), which does not
    // change this number.
    void set_generation(double generation) { generation_ = generation; }

    template <typename Io>
    void visit_clock(Io& io) {
        io.number(generation_, 0, 1e15);
    }
    template <typename Io>
    void visit(Io& io) {
        visit(io, now_);
        visit(io, before_);
    }

  private:
    struct Sums {
        double power[kLines];
        double blocks;
    };

    static void add(Sums& to, const Sums& more) {
        for (int i = 0; i < kLines; ++i) to.power[i] += more.power[i];
        to.blocks += more.blocks;
    }

    template <typename Io>
    static void visit(Io& io, Sums& sums) {
        io.number(sums.blocks, 0, 1e15);
        for (int i = 0; i < kLines && io.sound(); ++i) io.real(sums.power[i], 0, 1e60);
    }

    Sums now_, before_;
    double generation_;
};

}  // namespace fltea
