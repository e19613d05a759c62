// The samples of an axis that the tracker remembers, and how a filter processes them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "refilter.hpp"

namespace fltea {
namespace track {

// Number, mean and variance of those among some samples that are known.
struct KnownSamples {
    int count;
    double mean, variance;
};

// The samples from which a filter can restart: the past (past.hpp) and the recent samples, which are not yet
// part of the past, because they may turn out to be motion. Unknown samples are NaN. The steps of the bias
// are remembered, too.
struct Remembered {
    enum { kRecent = 2 * RestGate::kChunk };

    // Starts `filter` again and lets it process all remembered samples. Returns their log likelihood up to a
    // constant.
    double filter_again(const System<kMost>& s, const RiccatiMap<kMost>& map, Kalman<kMost>& filter) const {
        refilter::Likelihood fits;
        filter_means(s, map, filter, fits);
        filter_single(s, filter, 0, singles(), fits, [](double) {});
        return fits.value();
    }

    // Starts `filter` again and lets it process the means of older samples. After that, filter_single() has
    // to be called for the samples that are kept singly.
    void filter_means(const System<kMost>& s, const RiccatiMap<kMost>& map, Kalman<kMost>& filter,
                      refilter::Likelihood& fits) const {
        double x[kMost] = {0}, P[kMost * kMost];
        std::memcpy(P, s.P0, sizeof(double) * std::size_t(s.n * s.n));
        std::int64_t first = total - singles();
        std::int64_t begins[Past::kLevels], m = Past::kGroup;
        for (int level = 0; level < Past::kLevels; ++level, m *= Past::kGroup) {
            first -= m * past.means(level).count();
            begins[level] = first;
        }
        for (int level = Past::kLevels - 1; level >= 0; --level) {
            m /= Past::kGroup;
            refilter::through(s, past.means(level), m, begins[level], steps, x, P, fits);
        }
        std::memcpy(filter.x, x, sizeof x);
        filter.start(&s, &map, P);
    }

    // Filters the samples that are kept singly, from index `begin` to before `end`. Calls `tell` with each
    // innovation divided by its standard deviation, or with NaN for an unknown sample.
    template <typename Tell>
    void filter_single(const System<kMost>& s, Kalman<kMost>& filter, int begin, int end,
                       refilter::Likelihood& fits, Tell tell) const {
        const int single = past.single().count(), offset = s.offset();
        std::int64_t number = total - singles() + begin;
        for (int i = begin; i < end; ++i, ++number) {
            const double step = offset < 0 ? 0 : steps.within(number, number + 1);
            if (step > 0) filter.widen(offset, step);
            const double y = i < single ? past.single()[i] : double(recent[i - single]);
            const double e = filter.innovation(std::isnan(y) ? 0 : y);
            if (!std::isnan(y)) fits.add(e, filter.S);
            tell(std::isnan(y) ? y : e / std::sqrt(filter.S));
            filter.go_on(e, !std::isnan(y));
        }
    }

    // Number of samples that are kept singly, not as means of several: the single ones in `past` and the
    // recent ones.
    int singles() const { return past.single().count() + kept; }

    // Appends a sample; NaN stands for an unknown sample. If the sample ends a chunk, call roll() next.
    void add(float y) {
        recent[kept++] = y;
        ++total;
    }
    // Ends a chunk of samples. The chunk before it is appended to the past (past.hpp). The chunk that ends
    // now stays among the recent samples, because it may still turn out to be motion.
    void roll() {
        if (kept < kRecent) return;
        past.add(recent);
        std::memcpy(recent, recent + RestGate::kChunk, sizeof(float) * RestGate::kChunk);
        kept = RestGate::kChunk;
    }
    // Makes room for a sample that is still to come, whose value is not known yet.
    void foresee() {
        add(__builtin_nanf(""));
        if (kept == kRecent) roll();
    }
    // Whether `other` remembers the same samples and the same steps of the bias. The values of the newest
    // `but_newest` samples may differ.
    bool is(const Remembered& other, int but_newest) const {
        if (total != other.total || kept != other.kept || !steps.is(other.steps)) return false;
        const int recently = kept - but_newest;
        return past.is(other.past, recently < 0 ? -recently : 0) &&
               (recently <= 0 ||
                std::memcmp(recent, other.recent, sizeof(float) * std::size_t(recently)) == 0);
    }

    // Marks the newest `count` samples as unknown, except those that were already averaged into means of
    // several samples. Forgets the steps of the bias at these samples.
    void forget(int count) {
        for (int i = kept - count < 0 ? 0 : kept - count; i < kept; ++i) recent[i] = __builtin_nanf("");
        if (count > kept) past.forget(count - kept);
        steps.forget(total - count);
    }

    // Forgets the past and the steps of the bias, and marks the recent samples as unknown.
    void forget_all() {
        past.clear();
        steps.clear();
        for (int i = 0; i < kept; ++i) recent[i] = __builtin_nanf("");
    }

    void clear() {
        past.clear();
        steps.clear();
        kept = 0;
    }

    // Returns the newest `count` samples, or all samples that are kept singly if these are fewer. Unknown
    // samples are NaN.
    std::vector<double> newest(int count) const {
        const int single = past.single().count(), there = singles();
        std::vector<double> found;
        for (int i = count < there ? there - count : 0; i < there; ++i) {
            found.push_back(i < single ? past.single()[i] : double(recent[i - single]));
        }
        return found;
    }

    // Returns number, mean and variance of the known samples among the `count` samples just before the newest
    // `but` ones. Samples that are no longer kept singly are left out.
    KnownSamples known_samples(int count, int but = 0) const {
        const std::vector<double> all = newest(but + count);
        KnownSamples found = {0, 0, 0};
        double sum = 0, squares = 0;
        for (std::size_t i = 0; i + std::size_t(but) < all.size(); ++i) {
            if (std::isnan(all[i])) continue;
            sum += all[i];
            squares += all[i] * all[i];
            ++found.count;
        }
        if (found.count == 0) return found;
        found.mean = sum / found.count;
        found.variance = std::fmax(squares / found.count - found.mean * found.mean, 0);
        return found;
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(kept, 0, kRecent - 1);
        io.number(total, 0, 1e15);
        past.visit(io);
        steps.visit(io);
        for (int i = 0; i < kept && io.sound(); ++i) visit_known(io, recent[i]);
    }

    // Returns 2 log L of the remembered samples if a system describes them, up to a constant. Returns NaN if
    // no filter can work with the system.
    double likelihood(const System<kMost>& s) const {
        RiccatiMap<kMost> map;
        if (!map.set(s)) return __builtin_nan("");
        Kalman<kMost> filter;
        return 2 * filter_again(s, map, filter);
    }

    Past past;
    refilter::Steps steps;
    float recent[kRecent];
    int kept = 0;
    std::int64_t total = 0;  // number of all samples so far, including lost samples
};

}  // namespace track
}  // namespace fltea
