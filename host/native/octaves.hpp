// Everything that is kept of the noise of one axis for its spectrum and its Allan variance. Its size in
// memory does not grow with the length of the record.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "allan_sums.hpp"
#include "real_spectrum.hpp"

namespace fltea {

// Passes the samples that the gate (gate.hpp) has accepted on to the spectrum and to the Allan sums. The gate
// calls accept() for consecutive samples, with the sequence number of the first of them, and cut() where the
// stream has a break.
template <typename Number>
struct AcceptedStream {
    explicit AcceptedStream(double memory) : ladder(memory), allan(memory), next_(0) {}

    void accept(const double* y, int n, std::uint64_t first, const unsigned char* made_up) {
        ladder.accept(y, n, first, made_up);
        if (first != next_) allan.cut(double(first - next_));
        allan.add(y, std::size_t(n));
        next_ = first + std::uint64_t(n);
    }
    void cut() {
        ladder.cut();
        allan.cut();
    }
    void age(std::uint64_t now) { ladder.age(now); }
    void merge(const AcceptedStream& other, std::uint64_t shift, std::uint64_t now) {
        ladder.merge(other.ladder, shift, now);
        allan.merge(other.allan);
        next_ = now;
    }
    template <typename Io>
    void visit(Io& io) {
        ladder.visit(io);
        io.number(next_, 0, 1e15);
        std::vector<double> numbers = allan.save();
        std::size_t size = numbers.size();
        io.number(size, 0, kMostNumbers);
        if (!io.sound()) return;
        numbers.resize(size);
        for (double& one : numbers) io.real(one, -1e300, 1e300);
        if (io.sound()) io.require(allan.load(numbers.data(), size));
    }

    engine::OctaveLadder<RealSpectrum<Number>> ladder;
    AllanSums allan;

  private:
    enum { kMostNumbers = 4 + allan::kLevels * (allan::kHistory + allan::kChunk) + 4 * allan::kOctaves };
    std::uint64_t next_;  // expected sequence number of the next sample
};

// `moved`: number of samples that were left out because of motion. `motions`: number of motions.
struct MotionCounts {
    std::uint64_t moved, motions;
};

// Spectrum and Allan sums of one axis. The gate (gate.hpp) decides which samples are added. `memory`: length
// of the memory [samples]; 0: nothing is forgotten.
template <typename Number>
class Octaves {
  public:
    explicit Octaves(double memory = 0) : accepted_(memory) {}

    const engine::GateCounts& counts() const { return gate_.counts(); }
    const MotionCounts& motion() const { return motion_; }
    bool constant() const { return gate_.constant(); }
    std::uint64_t now() const { return gate_.number(); }
    const engine::OctaveLadder<RealSpectrum<Number>>& ladder() const { return accepted_.ladder; }
    const AllanSums& allan() const { return accepted_.allan; }

    void add(const double* y, std::size_t n, std::size_t stride) { gate_.add(y, n, stride, accepted_); }
    // Adds samples, except those in motion. If a motion has lasted for more than `longest` samples without
    // kRest consecutive samples at rest, the samples after these count as noise, because the noise may have
    // become stronger for good.
    void add(const double* y, const unsigned char* moving, std::size_t n, std::size_t stride,
             std::uint64_t longest) {
        for (std::size_t i = 0, next; i < n; i = next) {
            const bool moves = moving[i * stride] != 0;
            next = i + 1;
            while (next < n && (moving[next * stride] != 0) == moves) ++next;
            std::uint64_t left_out = moves && lasts_ < longest ? longest - lasts_ : 0;
            if (left_out > next - i) left_out = next - i;
            if (left_out > 0) leave_out(left_out);
            rest_ = moves ? 0 : rest_ + (next - i);
            if (rest_ > kRest) rest_ = kRest;
            lasts_ = rest_ == kRest || (lasts_ == 0 && !moves) ? 0 : lasts_ + (next - i);
            i += left_out;
            add(y + i * stride, next - i, stride);
        }
    }
    void skip(std::uint64_t count) { gate_.skip(count); }

    // Adds the samples that wait in the incomplete chunk, and drops what is forgotten by now. After that, the
    // stream has a break.
    void finish() {
        gate_.finish(accepted_);
        accepted_.age(now());
    }

    // Returns a copy of this instance, on which finish() was called, so that results can be read from the
    // copy. This instance itself is not changed.
    Octaves finished() const {
        Octaves copy(*this);
        copy.finish();
        return copy;
    }

    // The level with the lowest sampling rate keeps its samples as they are. Turns these samples into Welch
    // sums (sums of the power spectra of blocks), so that the record of the spectrum over time includes them.
    void deepen() {
        if (accepted_.ladder.depth() < accepted_.ladder.kLevels - 1) accepted_.ladder.deepen();
    }

    // Merges the sums of a later part of the stream into these. Both must have the same memory length. After
    // that, this instance has a break at its end.
    void merge(const Octaves& other) {
        finish();
        const Octaves later = other.finished();
        const std::uint64_t shift = now();
        gate_.merge(later.gate_);
        accepted_.merge(later.accepted_, shift, now());
        motion_.moved += later.motion_.moved;
        motion_.motions += later.motion_.motions;
        lasts_ = later.lasts_;
        rest_ = later.rest_;
    }

    template <typename Io>
    void visit(Io& io) {
        gate_.visit(io);
        for (std::uint64_t* one : {&motion_.moved, &motion_.motions, &lasts_}) io.number(*one, 0, 1e15);
        io.number(rest_, 0, kRest);
        if (io.sound()) accepted_.visit(io);
    }

  private:
    enum { kRest = 1024 };

    void leave_out(std::uint64_t count) {
        if (lasts_ == 0 || rest_ > 0) ++motion_.motions;
        motion_.moved += count + gate_.leave_out(count, accepted_);
    }

    engine::Gate<RealSpectrum<Number>> gate_;
    AcceptedStream<Number> accepted_;
    MotionCounts motion_ = MotionCounts();
    std::uint64_t lasts_ = 0;  // number of samples since the present motion began
    std::uint64_t rest_ = 0;   // during a motion: how many of the newest samples in a row were at rest
};

}  // namespace fltea
