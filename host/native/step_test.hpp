// Tests whether the bias of an axis has stepped, by a generalised likelihood ratio of its filter's
// innovations over windows of 16 to 16,384 samples (Basseville & Nikiforov, Detection of Abrupt Changes,
// 1993, section 2.4). The innovations of a correct filter are white, so a step by δ standard deviations
// raises log L by n δ² / 2 after n samples. A test that gives at most one false alarm a week needs at least
// about 30 / δ² samples to detect such a step (Lorden, Ann. Math. Statist. 42, 1971).
//
// Filters are never exactly correct, so the sum of the innovations in a window may vary more than that of
// white innovations. Each sum is therefore compared with the usual size of such a sum. This is the running
// mean of the squares of earlier sums, in windows of the same length.
#pragma once

#include <cmath>

namespace fltea {
namespace track {

struct StepSeen {
    enum Kind { kNothing, kStep, kDrift };
    Kind kind;
    int ago;  // number of samples since the change of the mean, including the newest one
    // change of the mean of the innovations, in standard deviations of an innovation; for a drift, the change
    // so far
    double size;
};

// A possible step: its probability, its size in standard deviations of an innovation, and the variance of
// that size.
struct StepSuspected {
    double likely, size, variance;

    // Adds the possible step to a bias and its variance. The result is a mean of two values: the bias if
    // there was a step, and the bias if there was none. The probability of the step weights them.
    // `deviation`: standard deviation of an innovation.
    void add_to(double& bias, double& bias_variance, double deviation) const {
        if (!(likely > 0)) return;
        const double change = size * deviation;
        bias += likely * change;
        bias_variance += likely * (1 - likely) * change * change + likely * variance * deviation * deviation;
    }
};

class StepTest {
  public:
    // kSure: A step that raises log L by this is reported. There is then less than one false report a week.
    // kEven: A step that raises log L by this has the probability 1/2. Without a step, such a rise happens
    // once in some hours.
    static constexpr double kSure = 18, kEven = 13;

    // The likeliest step among those that are not certain enough to be reported.
    const StepSuspected& suspected() const { return suspected_; }

    // Adds an innovation that was divided by its standard deviation. Returns the step or drift that is
    // detected at this sample, or kNothing. If something is detected, call clear() next.
    StepSeen add(double z) {
        const double used = louder(z);
        total_ += used;
        if (++samples_ % kBlock != 0) return nothing();
        for (int l = 0, size = kBlock; l < kLevels; ++l, size *= kUp) {
            if (samples_ % size != 0) break;
            Level& level = levels_[l];
            level.push(total_);
            const StepSeen found = judge(l, size);
            if (found.kind != StepSeen::kNothing) return found;
        }
        suspect();
        return nothing();
    }

    // Restarts the sums of innovations, and keeps what is known of their usual size.
    void clear() {
        total_ = 0;
        samples_ = 0;
        for (Level& level : levels_) level.clear();
        suspected_ = StepSuspected{0, 0, 0};
    }

    // The test needs to know how large the sums of innovations in windows usually are. This function adds an
    // innovation to these statistics, without testing for a step. A new filter calls it for the remembered
    // samples. The sums continue from one call to the next.
    void take(double z) {
        const double used = louder(z);
        total_ += used;
        if (++samples_ % kBlock != 0) return;
        for (int l = 0, size = kBlock; l < kLevels && samples_ % size == 0; ++l, size *= kUp) {
            Level& level = levels_[l];
            level.push(total_);
            for (int w = l == 0 ? 0 : 1; w < kWindows && blocks_of(w) <= level.count; ++w) {
                learn(level.windows[w], blocks_of(w), size, level.newest(blocks_of(w)), kAnything);
            }
        }
    }

    // Reduces the weight of earlier innovations in the statistics of the usual size of their sums. Call this
    // when the filter has changed.
    void relearn() {
        for (Level& level : levels_) {
            for (Window& one : level.windows) {
                if (one.count > kWeight) one.count = kWeight;
            }
        }
    }

    template <typename Io>
    void visit(Io& io) {
        io.real(total_, -1e15, 1e15);
        io.number(samples_, 0, 1e15);
        io.real(last_, -1e150, 1e150);
        io.real(power_, 0, 1e300);
        for (Level& level : levels_) level.visit(io);
        suspect();
    }

  private:
    enum { kLevels = 4, kBlock = 4, kUp = 8, kKept = 32, kWindows = 7, kWeight = 8, kMostCounted = 200 };
    // Innovations are clipped at this number of standard deviations, so that a glitch is not taken for a
    // step.
    static constexpr double kClip = 4;
    static constexpr double kPower = 1 / 64.0;
    // In the statistics, the square of a sum of innovations is limited to this many times the mean of earlier
    // squares.
    static constexpr double kOutlier = 9, kAnything = 100;

    // Statistics of the sums of innovations in windows of one length. `usual`: ratio of the mean square of
    // such sums to that for white innovations. It is computed from differences between neighbouring windows,
    // so steps and drifts do not raise it.
    struct Window {
        double usual;
        int count, since;
        bool has_last;
        double last;  // sum of the innovations in the newest window that was added to the statistics
    };

    struct Suspect {
        double gain, size, length;
    };

    // A ring buffer that has, for each of the newest blocks, the sum of all innovations up to the end of the
    // block.
    struct Level {
        double ends[kKept + 1] = {};
        int at = 0, count = 0;
        Window windows[kWindows];
        Suspect suspect = {0, 0, 1};
        // For each length of window there is a mean square of the sums of innovations. This is the largest
        // one for all windows of this level and of the levels below.
        double absolute = 0;

        Level() {
            ends[0] = 0;
            for (Window& one : windows) one = Window{1, 0, 0, false, 0};
        }
        void clear() {
            at = count = 0;
            ends[0] = 0;
            suspect = Suspect{0, 0, 1};
            for (Window& one : windows) {
                one.since = 0;
                one.has_last = false;
            }
        }
        void push(double sum) {
            at = at == kKept ? 0 : at + 1;
            ends[at] = sum;
            if (count < kKept) ++count;
        }
        // Returns the sum of the innovations in the newest `blocks` blocks.
        double newest(int blocks) const {
            const int then = at - blocks;
            return ends[at] - ends[then < 0 ? then + kKept + 1 : then];
        }
        template <typename Io>
        void visit(Io& io) {
            io.number(at, 0, kKept);
            io.number(count, 0, kKept);
            for (double& one : ends) io.real(one, -1e15, 1e15);
            io.real(absolute, 0, 1e300);
            io.real(suspect.gain, 0, 1e15);
            io.real(suspect.size, -1e15, 1e15);
            io.real(suspect.length, 1, 1e15);
            for (Window& one : windows) {
                io.real(one.usual, 1e-300, 1e15);
                io.number(one.count, 0, kMostCounted);
                io.number(one.since, 0, kKept);
                io.number(one.has_last, 0, 1);
                io.real(one.last, -1e15, 1e15);
            }
        }
    };

    // Clips an innovation at kClip. If the noise has grown, the innovation is first divided by the standard
    // deviation that the noise now has. This follows from differences of neighbouring innovations, in which a
    // step hardly shows.
    double louder(double z) {
        const double apart = z - last_, square = apart * apart / 2;
        last_ = z;
        // A step causes a single large difference. The limit keeps it from counting as growing noise.
        const double most = kOutlier * (power_ > 1 ? power_ : 1);
        power_ += kPower * ((square < most ? square : most) - power_);
        const double used = power_ > 1 ? z / std::sqrt(power_) : z;
        return used > kClip ? kClip : used < -kClip ? -kClip : used;
    }

    static StepSeen nothing() { return StepSeen{StepSeen::kNothing, 0, 0}; }

    static int blocks_of(int window) {
        static const int blocks[kWindows] = {4, 6, 8, 11, 16, 23, 32};
        return blocks[window];
    }

    void suspect() {
        const Suspect* most = &levels_[0].suspect;
        for (const Level& level : levels_) {
            if (level.suspect.gain > most->gain) most = &level.suspect;
        }
        suspected_ = StepSuspected{0, 0, 0};
        if (!(most->gain > kEven / 2)) return;
        suspected_ = StepSuspected{1 / (1 + std::exp(kEven - most->gain)), most->size, 1 / most->length};
    }

    StepSeen judge(int l, int size) {
        Level& level = levels_[l];
        level.suspect = Suspect{0, 0, 1};
        // The mean square of the sums in long windows is taken to be at least that in shorter ones. The
        // reason is that a spectral line cancels in windows that are as long as its period, but not in
        // shorter ones.
        double absolute = l == 0 ? 0 : levels_[l - 1].absolute;
        // The blocks of a level are kUp times as long as those of the level below. The shortest window is
        // tested only at the lowest level. At every other level, it is as long as the longest window of the
        // level below, which was tested already.
        for (int w = l == 0 ? 0 : 1; w < kWindows; ++w) {
            const int blocks = blocks_of(w);
            if (blocks > level.count || blocks * size > kLongest) break;
            Window& window = level.windows[w];
            const double length = double(blocks) * size, sum = level.newest(blocks);
            const double square = sum * sum, beside = std::fmax(usual(l, w) * length, absolute);
            if (window.count >= kWeight) absolute = std::fmax(absolute, window.usual * length);
            // a step in this window would raise log L by more than kEven / 2 (`gain` below); less is ignored
            if (square > kEven * beside) {
                const double gain = square / (2 * beside);
                if (gain > kSure) return found(level, size, blocks);
                if (gain > level.suspect.gain && length >= kSuspected) {
                    level.suspect = Suspect{gain, sum / length, length};
                }
            }
            learn(window, blocks, size, sum, kOutlier);
        }
        level.absolute = absolute;
        return nothing();
    }

    // Updates the running mean square of the sums of innovations in windows of one length. Only windows that
    // do not overlap are used.
    static void learn(Window& window, int blocks, int size, double sum, double outlier) {
        if (++window.since < blocks) return;
        window.since = 0;
        const double apart = sum - window.last, square = apart * apart / (2 * double(blocks) * size);
        window.last = sum;
        if (!window.has_last) {
            window.has_last = true;
            return;
        }
        const double used = std::fmin(square, outlier * std::fmax(window.usual, 1));
        if (window.count < kMostCounted) ++window.count;
        window.usual += (used - window.usual) / (window.count + kWeight);
    }

    // Returns the usual mean square of the sums in windows of one length, divided by that for white
    // innovations. The ratio is at least 1. If there were fewer than kWeight such windows, it is also at
    // least the largest ratio of any shorter window.
    double usual(int l, int w) const {
        const Window& own = levels_[l].windows[w];
        double most = std::fmax(own.usual, 1);
        if (own.count >= kWeight) return most;
        for (int i = 0; i <= l; ++i) {
            for (int k = i == 0 ? 0 : 1; k < (i == l ? w : int(kWindows)); ++k) {
                const Window& one = levels_[i].windows[k];
                if (one.count >= kWeight) most = std::fmax(most, one.usual);
            }
        }
        return most;
    }

    // Finds when a detected change began and how large it is. Tries the ends of all blocks as the beginning,
    // and tests whether a steadily growing mean (a drift) fits better than a step.
    StepSeen found(const Level& level, int size, int blocks) const {
        const StepSeen step = likeliest_step(size), drift = likeliest_drift(level, size);
        const double of_step = step.size * step.size * step.ago / 2,
                     of_drift = drift.size * drift.size * drift.ago / 6;
        const bool long_enough = blocks * size >= kShortestDrift;
        return long_enough && of_drift > of_step ? drift : step;
    }

    StepSeen likeliest_step(int coarsest) const {
        StepSeen best = {StepSeen::kStep, 0, 0};
        double most = 0;
        for (int l = 0, size = kBlock; l < kLevels && size <= coarsest; ++l, size *= kUp) {
            for (int k = 1; k <= levels_[l].count; ++k) {
                const double n = double(k) * size, sum = levels_[l].newest(k), gain = sum * sum / (2 * n);
                if (gain > most) {
                    most = gain;
                    best.ago = k * size;
                    best.size = sum / n;
                }
            }
        }
        return best;
    }

    // Returns the likeliest drift. In a drift, the mean has grown linearly from 0 to `size` during the newest
    // `ago` innovations. This raises log L by size² ago / 6.
    StepSeen likeliest_drift(const Level& level, int size) const {
        StepSeen best = {StepSeen::kDrift, 0, 0};
        // `later`: sum of the innovations in the blocks that are newer than the k-th newest block
        double most = 0, moment = 0, later = 0;
        for (int k = 1; k <= level.count; ++k) {
            const double all = level.newest(k);
            moment += size * (later + (all - later) / 2);
            later = all;
            const double n = double(k) * size, squares = n * n * n / 3,
                         gain = moment * moment / (2 * squares);
            if (gain > most) {
                most = gain;
                best.ago = k * size;
                best.size = moment / squares * n;
            }
        }
        return best;
    }

    // kSuspected: A window with fewer innovations than this causes no suspicion of a step (StepSuspected). If
    // there is a step in so short a window, it is either reported soon or was chance.
    enum { kLongest = 16384, kShortestDrift = 1024, kSuspected = 64 };

    StepSuspected suspected_ = StepSuspected{0, 0, 0};
    double total_ = 0, last_ = 0, power_ = 1;
    long long samples_ = 0;
    Level levels_[kLevels];
};

}  // namespace track
}  // namespace fltea
