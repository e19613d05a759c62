// Makes bins from the board's running spectrum (count_spectrum.hpp). The device fits noise models to these
// bins. A bin is an average over neighbouring frequencies (lines) of the spectrum. Bins are made in small
// steps, so that sampling never has to wait.
#ifndef FLTEA_FIT_BINS_HPP
#define FLTEA_FIT_BINS_HPP

#include <cstddef>
#include <cstdint>

#include "count_spectrum.hpp"
#include "octave_tables.hpp"
#include "real_math.hpp"
#include "whole_lines.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The bins of one axis, with powers in squared counts. A bin extends over about 8 % of its frequency. In an
// octave whose spectrum comes from Welch sums (summed periodograms of blocks), a bin contains at least two of
// the periodogram's frequencies.
template <class Spectrum, int kMost = 176>
class FitBins {
    typedef typename Spectrum::Ladder Ladder;
    typedef typename Ladder::Whole Whole;
    enum { kCapacity = Whole::kCapacity, kLowest = 4, kFirst = Ladder::Top::kLowest, kBlock = 256 };

  public:
    FitBins() : size_(0), ordinates_(0), stage_(kDone), stretch_(0), line_(0) {}

    int size() const { return size_; }
    // Effective number of independent periodogram ordinates in all bins.
    float ordinates() const { return ordinates_; }
    // Mean power of the periodogram ordinates.
    float mean_power() const { return sum_ / ordinates_; }
    float lam(int i) const { return lam_[i]; }
    float counts(int i) const { return counts_[i]; }
    float power(int i) const { return power_[i]; }
    float ln_size(int i) const { return ln_size_[i]; }
    // Number of bins that were omitted because the array of bins was full.
    int left_out() const { return left_out_; }

    // Begins to make the bins of `spectrum`, which must not change until step() has returned true.
    void begin() {
        size_ = left_out_ = 0;
        ordinates_ = sum_ = 0;
        stage_ = kWelch;
        stretch_ = 0;
        line_ = 0;
        open_ = Open();
    }

    // Does a small part of the work. Returns true when all bins are complete. Each of the first steps makes
    // bins from the Welch sums of one octave, from the highest frequencies down. The lowest frequencies come
    // from the level that stores its samples, in stretches without a gap. Each further step prepares one of
    // these stretches, or computes one periodogram ordinate of it. If there are more bins than the array can
    // hold, the last bins are omitted.
    bool step(const Spectrum& spectrum) {
        const Ladder& ladder = spectrum.ladder();
        const int depth = ladder.depth();
        switch (stage_) {
            case kWhole:
                whole_step(spectrum, depth);
                break;
            case kWelch:
                if (stretch_ == depth) {
                    stage_ = kWhole;
                    stretch_ = 0;
                } else {
                    welch_level(spectrum, stretch_++);
                }
                break;
            default:
                break;
        }
        return stage_ == kDone;
    }

  private:
    enum Stage { kWhole, kWelch, kDone };

    // The bin in progress, to which neighbouring frequencies of the spectrum are added.
    struct Open {
        float begin, lam, weight, power;
        int lines;
        Open() : begin(0), lam(0), weight(0), power(0), lines(0) {}
    };

    static float two_to(int exponent) { return fixed::to_float(1, exponent); }
    static constexpr float kTurn = 6.2831853f;

    void whole_step(const Spectrum& spectrum, int depth) {
        const Whole& whole = spectrum.ladder().whole();
        if (stretch_ == whole.stretches()) {
            stage_ = kDone;
            return;
        }
        const int n = whole.stretch(stretch_).length;
        if (line_ == 0) {
            if (n < Whole::kShortest) {
                ++stretch_;
                return;
            }
            int begin = 0;
            for (int i = 0; i < stretch_; ++i) begin += whole.stretch(i).length;
            lines_.take(whole.values() + begin, n, depth > 0);
            line_ = kLowest;
            return;
        }
        // Index of the highest ordinate to compute: the last one below the frequencies that the Welch sums of
        // the octave above cover. If there are no Welch sums, it is the last one below the Nyquist frequency.
        const int last = depth == 0 ? (n - 1) / 2 : ((2 * kFirst - 1) * n - 1) / kBlock;
        if (line_ > last) {
            close();
            line_ = 0;
            ++stretch_;
            return;
        }
        const float step = kTurn / static_cast<float>(n) * two_to(-depth);
        // one ordinate is enough for a bin here (two frequencies are the minimum in Welch sums)
        add(step * static_cast<float>(line_), 1.0f,
            lines_.power(line_) * two_to(spectrum.exponent(depth) + depth), 1);
        ++line_;
    }

    void welch_level(const Spectrum& spectrum, int level) {
        float power[Ladder::kTopLines], blocks = 0, effective = 0;
        spectrum.ladder().sums(level, 0, power, &blocks, &effective);
        if (!(blocks > 0)) return;
        // Each frequency of the Welch sums counts as `weight` independent ordinates. This number is smaller
        // than the number of blocks, because neighbouring frequencies under Hann's window are correlated, and
        // so are blocks that overlap by half.
        const float weight = blocks / (1.0f + 17.0f / 18.0f + 2.0f / 12.0f * (1.0f - 1.0f / blocks));
        const float scale = two_to(spectrum.exponent(level) + level) / (96.0f * blocks);
        const float step = kTurn / static_cast<float>(kBlock) * two_to(-level);
        for (int i = 0; i < Ladder::lines(level); ++i) {
            const float passed = level == 0 ? 1.0f : OctaveGains<>::over[level < 3 ? level - 1 : 2][i];
            add(step * static_cast<float>(kFirst + i), weight, power[i] * scale * passed, 2);
        }
        close();
    }

    void add(float lam, float weight, float power, int fewest) {
        if (open_.lines >= fewest && lam > 1.08f * open_.begin) close();
        if (open_.lines == 0) open_.begin = lam;
        open_.lam += weight * lam;
        open_.weight += weight;
        open_.power += weight * power;
        ++open_.lines;
    }

    void close() {
        if (open_.lines == 0) return;
        if (size_ == kMost) {
            ++left_out_;
        } else {
            const float lam = open_.lam / open_.weight;
            lam_[size_] = lam;
            counts_[size_] = open_.weight;
            power_[size_] = open_.power / open_.weight;
            // at the frequency λ, |1 - e^{-iλ}| = 2 sin(λ/2)
            ln_size_[size_] = math::log(2.0f * math::sin_pi(lam * (0.5f / 3.14159265f)));
            ordinates_ += open_.weight;
            sum_ += open_.power;
            ++size_;
        }
        open_ = Open();
    }

    float lam_[kMost], counts_[kMost], power_[kMost], ln_size_[kMost];
    int size_, left_out_ = 0;
    float ordinates_, sum_ = 0;
    Stage stage_;
    // `stretch_`: first the index of the octave whose Welch sums come next. After all octaves, the index of
    // the stretch of stored samples that comes next, for the lowest frequencies.
    int stretch_, line_;
    Open open_;
    WholeLines<kCapacity> lines_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea

#endif
