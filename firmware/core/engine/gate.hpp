// Decides which samples of an axis show its noise, and where the stream of samples has breaks. In the
// following, the "running level" is the running mean of the variance of accepted chunks.
//
// Samples are judged in consecutive chunks of 128.
//
// A chunk is called a knock and left out in two cases: its power about its own mean, without the largest
// sample, exceeds sixteen times the running level; or its largest sample is more than a hundred standard
// deviations away from that mean. Noise alone rarely exceeds these limits. Noise with Student's t
// distribution of four degrees of freedom exceeds them in one of 10^8 samples, and a random walk in one of
// 10^6 chunks. After eight consecutive knocks, the variance of these chunks becomes the running level.
//
// Single samples of an accepted chunk are limited to the chunk's mean ± twelve standard deviations of the
// running level. Otherwise a few large samples close together would dominate the whole spectrum with their
// own shape.
//
// A chunk is also left out if its mean differs from that of the previous chunk much more than usual. Such a
// difference is a step of the offset. The whole chunk is left out, because the step may lie within it.
//
// Gaps of up to eight lost samples are filled by a straight line, as long as at most one sample in a thousand
// is filled in. At other gaps the stream has a break.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

struct GateCounts {
    std::uint64_t taken;    // samples that were received
    std::uint64_t used;     // samples that were accepted
    std::uint64_t bridged;  // lost samples that were filled in
    std::uint64_t lost;     // all lost samples
    std::uint64_t gaps;     // breaks of the stream that lost samples have caused
    std::uint64_t knocks;   // chunks that were left out as knocks (disturbances)
    std::uint64_t knocked;  // samples that were left out because of knocks and steps
    std::uint64_t steps;
    // How often the noise's power has changed: kKnocksToChange consecutive chunks were left out as knocks,
    // and then their variance became the new running level (the usual variance).
    std::uint64_t changes;
    std::uint64_t limited;  // samples that were clipped because they were far from the mean of their chunk
};

template <typename Kind>
class Gate {
    typedef typename Kind::Input Input;
    typedef typename Kind::Real Real;

  public:
    enum { kChunk = 128, kLongestBridge = 8, kKnocksToChange = 8, kRunning = 256, kFewestJumps = 16 };
    // Limits, as multiples of the running level, which is the running mean of the variance of accepted
    // chunks. A chunk is a knock if its power exceeds kKnock, or the squared distance of a sample from the
    // chunk's mean exceeds kSpike. In an accepted chunk, samples are clipped at the squared distance kLimit.
    enum { kKnock = 16, kSpike = 10000, kLimit = 144 };

    Gate()
        : fill_(0),
          number_(0),
          missing_(0),
          bridged_(0),
          has_last_(0),
          has_mean_(0),
          credit_(0),
          last_(0),
          mean_(0),
          level_(0),
          chunks_(0),
          knocks_(0),
          knocks_level_(0),
          jumps_(0),
          jumps_level_(0),
          resolution_(infinity()),
          value_(0),
          changed_(0) {
        std::memset(&counts_, 0, sizeof counts_);
        std::memset(made_up_, 0, sizeof made_up_);
    }

    const GateCounts& counts() const { return counts_; }
    // Number of the next sample; lost samples count, too.
    std::uint64_t number() const { return number_ + std::uint64_t(fill_) + missing_; }
    // Whether all samples so far were equal.
    bool constant() const { return counts_.taken > 0 && !changed_; }

    // Adds the n samples y[i * stride], which must be finite and within ±1e100. When a chunk is accepted,
    // calls sink.accept(values, n, number of the first value, made_up), where made_up[i] is 1 if value i was
    // filled in. At a break of the stream, calls sink.cut().
    template <typename Sink>
    void add(const Input* y, std::size_t n, std::size_t stride, Sink& sink) {
        while (n > 0) {
            if (missing_ > 0) end_gap(*y, sink);
            const std::size_t room = std::size_t(kChunk - fill_), part = n < room ? n : room;
            for (std::size_t i = 0; i < part; ++i) chunk_[std::size_t(fill_) + i] = y[i * stride];
            note_change(chunk_ + fill_, int(part));
            fill_ += int(part);
            counts_.taken += part;
            credit_ = credit_ + int(part) < kMostCredit ? credit_ + int(part) : int(kMostCredit);
            last_ = chunk_[fill_ - 1];
            has_last_ = 1;
            y += part * stride;
            n -= part;
            if (fill_ == kChunk) hand_on(sink);
        }
    }

    // Notes that `count` samples are missing before the next sample.
    void skip(std::uint64_t count) {
        missing_ += count;
        counts_.lost += count;
    }

    // Leaves out the next `count` samples, and also the samples that wait in the incomplete chunk. Returns
    // how many samples that chunk had.
    template <typename Sink>
    std::uint64_t leave_out(std::uint64_t count, Sink& sink) {
        const std::uint64_t waiting = std::uint64_t(fill_ - bridged_);
        if (missing_ > 0 && has_last_) ++counts_.gaps;
        number_ = number() + count;
        counts_.taken -= waiting;
        counts_.bridged -= std::uint64_t(bridged_);
        std::memset(made_up_, 0, sizeof made_up_);
        missing_ = 0;
        fill_ = bridged_ = 0;
        end_stretch(sink);
        return waiting;
    }

    // Judges the incomplete chunk, and makes a break of the stream after it.
    template <typename Sink>
    void finish(Sink& sink) {
        if (fill_ > 0) hand_on(sink);
        end_stretch(sink);
    }

    // Adds the counts and running means of `other`, the gate of a later part of the stream, to those of this
    // gate. finish() must have been called on both.
    void merge(const Gate& other) {
        number_ = number() + other.number();
        missing_ = 0;
        if (other.chunks_ > 0 && chunks_ > 0) {
            const Real weight = Real(other.chunks_) / Real(chunks_ + other.chunks_);
            level_ += (other.level_ - level_) * weight;
        } else if (other.chunks_ > 0) {
            level_ = other.level_;
        }
        chunks_ = least(chunks_ + other.chunks_, kRunning);
        if (other.jumps_ > 0) {
            const Real weight = Real(other.jumps_) / Real(jumps_ + other.jumps_);
            jumps_level_ += (other.jumps_level_ - jumps_level_) * weight;
        }
        jumps_ = least(jumps_ + other.jumps_, kRunning);
        knocks_ = other.knocks_;
        knocks_level_ = other.knocks_level_;
        if (other.resolution_ < resolution_) resolution_ = other.resolution_;
        if (other.counts_.taken > 0) {
            if (counts_.taken == 0) {
                value_ = other.value_;
            } else if (value_ != other.value_) {
                changed_ = 1;
            }
        }
        if (other.changed_) changed_ = 1;
        std::uint64_t* const to = fields(counts_);
        const std::uint64_t* const more = fields(const_cast<GateCounts&>(other.counts_));
        for (int i = 0; i < kFields; ++i) to[i] += more[i];
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(fill_, 0, kChunk - 1);
        io.number(number_, 0, 1e15);
        io.number(missing_, 0, 1e15);
        io.number(bridged_, 0, fill_);
        io.number(has_last_, 0, 1);
        io.number(has_mean_, 0, 1);
        io.number(credit_, 0, kMostCredit);
        io.real(last_, -1e100, 1e100);
        io.real(mean_, -1e100, 1e100);
        io.real(level_, 0, 1e203);
        io.number(chunks_, 0, kRunning);
        io.number(knocks_, 0, kKnocksToChange - 1);
        io.real(knocks_level_, 0, 1e203);
        io.number(jumps_, 0, kRunning);
        io.real(jumps_level_, 0, 1e203);
        // A snapshot must not contain infinite numbers, so an unknown resolution is saved as 0.
        Real resolution = resolution_ < infinity() ? resolution_ : Real(0);
        io.real(resolution, 0, 1e101);
        resolution_ = resolution > 0 ? resolution : infinity();
        io.real(value_, -1e100, 1e100);
        io.number(changed_, 0, 1);
        for (int i = 0; i < kFields; ++i) io.number(fields(counts_)[i], 0, 1e15);
        int made_up = 0;
        for (int i = 0; i < fill_ && io.sound(); ++i) {
            io.real(chunk_[i], -1e100, 1e100);
            io.number(made_up_[i], 0, 1);
            made_up += made_up_[i];
        }
        io.require(made_up == bridged_);
    }

  private:
    enum { kFields = sizeof(GateCounts) / sizeof(std::uint64_t), kPerBridged = 1000 };
    enum { kMostCredit = kLongestBridge * kPerBridged };

    static std::uint64_t* fields(GateCounts& counts) { return &counts.taken; }
    static int least(int a, int b) { return a < b ? a : b; }
    // This function does not use <limits>: the Arduino libraries define macros min and max, which break that
    // header.
    static Real infinity() { return Real(__builtin_inff()); }

    void note_change(const Input* y, int n) {
        if (changed_) return;
        if (counts_.taken == 0) value_ = y[0];
        for (int i = 0; i < n; ++i) {
            if (y[i] != value_) changed_ = 1;
        }
    }

    // Fills the gap of lost samples before the sample `next`, or makes a break of the stream there.
    template <typename Sink>
    void end_gap(Input next, Sink& sink) {
        const std::uint64_t missing = missing_;
        missing_ = 0;
        if (!has_last_) {
            number_ += missing;
            return;
        }
        if (missing > kLongestBridge || credit_ < int(missing) * kPerBridged) {
            if (fill_ > 0) hand_on(sink);
            end_stretch(sink);
            ++counts_.gaps;
            number_ += missing;
            return;
        }
        credit_ -= int(missing) * kPerBridged;
        const Real from = Real(last_), slope = (Real(next) - from) / Real(missing + 1);
        for (std::uint64_t i = 1; i <= missing; ++i) {
            chunk_[fill_] = Kind::input(from + slope * Real(i));
            made_up_[fill_++] = 1;
            ++bridged_;
            ++counts_.bridged;
            if (fill_ == kChunk) hand_on(sink);
            // The gap began in a chunk that is full now. The gate left this chunk out, with its last sample.
            if (!has_last_) {
                number_ += missing - i;
                return;
            }
        }
    }

    template <typename Sink>
    void end_stretch(Sink& sink) {
        if (has_last_) sink.cut();
        has_last_ = has_mean_ = credit_ = 0;
    }

    template <typename Sink>
    void hand_on(Sink& sink) {
        const std::uint64_t first = number_, measured = std::uint64_t(fill_ - bridged_);
        number_ += std::uint64_t(fill_);
        if (belongs()) {
            counts_.used += measured;
            sink.accept(static_cast<const Input*>(chunk_), fill_, first,
                        static_cast<const unsigned char*>(made_up_));
        } else {
            counts_.knocked += measured;
            end_stretch(sink);
        }
        if (bridged_ > 0) std::memset(made_up_, 0, sizeof made_up_);
        fill_ = bridged_ = 0;
    }

    // Whether the present chunk is accepted. An incomplete chunk has to stay below the same limit for the sum
    // of squares as a complete one.
    bool belongs() {
        const typename Kind::Moments moments(chunk_, fill_);
        const Real mean = moments.mean(), power = moments.power(), largest = moments.largest();
        if (bridged_ == 0) {
            const Real change = Kind::least_change(chunk_, fill_);
            if (change > 0 && change < resolution_) resolution_ = change;
        }
        // The variance that rounding to the resolution causes. The noise is at least that large, even while
        // hardly any sample differs from the one before.
        const Real rounding = resolution_ < infinity() ? resolution_ * resolution_ / 12 : Real(0);
        const bool whole = fill_ == kChunk;
        const Real variance = fill_ > 1 ? power / Real(fill_ - 1) : Real(0);
        if (chunks_ > 0) {
            const Real level = level_ > rounding ? level_ : rounding;
            if (power - largest > Real(kKnock) * level * Real(kChunk - 1) || largest > Real(kSpike) * level) {
                note_knock(variance);
                return false;
            }
            knocks_ = 0;
            if (whole && has_mean_ && is_step(mean - mean_, 2 * rounding / Real(kChunk))) return false;
            if (largest > Real(kLimit) * level) limit(mean, Kind::root(Real(kLimit) * level));
        }
        if (!whole) return true;
        mean_ = mean;
        has_mean_ = 1;
        chunks_ = least(chunks_ + 1, kRunning);
        level_ += (variance - level_) / Real(chunks_);
        return true;
    }

    void limit(Real mean, Real most) {
        for (int i = 0; i < fill_; ++i) {
            const Real apart = Real(chunk_[i]) - mean;
            if (apart <= most && -apart <= most) continue;
            chunk_[i] = Kind::input(apart < 0 ? mean - most : mean + most);
            ++counts_.limited;
        }
    }

    void note_knock(Real variance) {
        ++counts_.knocks;
        ++knocks_;
        knocks_level_ = knocks_ == 1 ? variance : knocks_level_ + (variance - knocks_level_) / Real(knocks_);
        if (knocks_ < kKnocksToChange) return;
        level_ = knocks_level_;
        chunks_ = kKnocksToChange;
        knocks_ = jumps_ = 0;
        jumps_level_ = 0;
        ++counts_.changes;
    }

    // Whether the mean has stepped from one chunk to the next. `jump`: difference of the two means. It is a
    // step if it is more than 5.5 times the usual jump (the root of the running mean of squared jumps). While
    // few jumps are known, this limit is higher, and the first kFewestJumps jumps are never steps. A step
    // enters the running mean as the largest jump that would not have been one. So a single step changes it
    // little, but noise that grows still raises it.
    bool is_step(Real jump, Real rounding) {
        const Real level = jumps_level_ > rounding ? jumps_level_ : rounding;
        const Real deviations = jumps_ > 0 ? Real(5.5) * (1 + Real(8) / Real(jumps_)) : Real(0);
        const Real largest = deviations * deviations * level;
        const bool step = jumps_ >= kFewestJumps && jump * jump > largest;
        const Real power = step ? largest : jump * jump;
        jumps_ = least(jumps_ + 1, kRunning);
        jumps_level_ += (power - jumps_level_) / Real(jumps_);
        if (step) ++counts_.steps;
        return step;
    }

    Input chunk_[kChunk];
    unsigned char made_up_[kChunk];
    int fill_;
    // `number_`: sample number of chunk_[0]. `missing_`: number of samples that were lost after the newest
    // one. Whether they are filled in is decided when the next sample comes.
    std::uint64_t number_, missing_;
    int bridged_, has_last_, has_mean_, credit_;
    // `last_`: newest sample. `mean_`: mean of the newest complete chunk. has_last_ and has_mean_ say whether
    // there was one since the last break.
    Input last_;
    Real mean_;
    Real level_;  // the running level: mean of the variances of `chunks_` chunks
    int chunks_;
    // `knocks_`: number of consecutive chunks, up to now, that were knocks. `knocks_level_`: mean of their
    // variances.
    int knocks_;
    Real knocks_level_;
    int jumps_;
    Real jumps_level_;
    Real resolution_;  // smallest nonzero change from one sample to the next one so far
    Input value_;      // the very first sample, with which constant() compares all others
    int changed_;
    GateCounts counts_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
