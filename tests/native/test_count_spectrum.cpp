// Tests of the running spectrum in integers (count_spectrum.hpp), which is compared with the same templates
// in floating point.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "count_spectrum.hpp"
#include "noise.h"
#include "real_spectrum.hpp"

using namespace fltea::engine;
using fltea::RealSpectrum;

namespace {

typedef CountSpectrum<> Counts;
typedef RealSpectrum<double, Counts::kLevels, Counts::kCapacity> Reals;

// Two spectra of the same samples, one in integers and one in floating point.
struct Pair {
    void add(std::int16_t y) {
        const double same = y;
        counted.add(y);
        gate.add(&same, 1, 1, real_ladder);
    }
    void skip(std::uint64_t lost) {
        counted.skip(lost);
        gate.skip(lost);
    }
    CountOctaves<> counted;
    Gate<Reals> gate;
    OctaveLadder<Reals> real_ladder;
};

std::int16_t counts_of(double y) {
    const double nearest = std::floor(y + 0.5);
    return static_cast<std::int16_t>(nearest > 32767 ? 32767 : nearest < -32768 ? -32768 : nearest);
}

double mean_of(const double* x, int n) {
    double sum = 0;
    for (int i = 0; i < n; ++i) sum += x[i];
    return sum / n;
}

// The largest differences between the two running spectra of a `Pair`: in integers and in floating point.
// Each level of a spectrum has the sums of one sampling rate; the slowest level keeps its samples instead.
//   bins: relative difference of the mean of three neighbouring lines, in levels with eight blocks or more
//   lines: difference of one line, relative to the line, or to a tenth of its level's mean if that is larger
//   whole: difference of the samples that the slowest level keeps, in standard deviations of noise of the
//     given variance at that level
// The numbers of blocks and the stretches of both spectra have to be equal.
struct Difference {
    double bins, lines, whole;
};

Difference difference(const Pair& pair, double variance) {
    Difference worst = {0, 0, 0};
    const CountOctaves<>::Ladder& counted = pair.counted.ladder();
    const OctaveLadder<Reals>& real = pair.real_ladder;
    REQUIRE(counted.depth() == real.depth());
    for (int l = 0; l < real.depth(); ++l) {
        float power[83], blocks, effective;
        double expected[83], real_blocks, real_effective;
        counted.sums(l, 0, power, &blocks, &effective);
        real.sums(l, 0, expected, &real_blocks, &real_effective);
        REQUIRE(static_cast<double>(blocks) == real_blocks);
        CHECK(effective == blocks);
        if (!(blocks > 0)) continue;
        double found[83];
        const int lines = counted.lines(l);
        const double least = mean_of(expected, lines) / 10;
        for (int i = 0; i < lines; ++i) {
            found[i] = std::ldexp(static_cast<double>(power[i]), pair.counted.exponent(l));
            const double apart = std::fabs(found[i] - expected[i]) / std::max(expected[i], least);
            worst.lines = std::max(worst.lines, apart);
        }
        for (int i = 0; i + 3 <= lines && blocks >= 8; i += 3) {
            worst.bins =
                std::max(worst.bins, std::fabs(mean_of(found + i, 3) / mean_of(expected + i, 3) - 1));
        }
    }
    REQUIRE(counted.whole().stretches() == real.whole().stretches());
    REQUIRE(counted.whole().size() == real.whole().size());
    const double deviation = std::sqrt(variance / std::ldexp(1.0, real.depth()));
    for (int i = 0; i < real.whole().size(); ++i) {
        const double found = std::ldexp(static_cast<double>(counted.whole().values()[i]),
                                        pair.counted.exponent(real.depth()) / 2);
        worst.whole = std::max(worst.whole,
                               std::fabs(found - static_cast<double>(real.whole().values()[i])) / deviation);
    }
    for (int i = 0; i < real.whole().stretches(); ++i) {
        CHECK(counted.whole().stretch(i).first == real.whole().stretch(i).first);
        CHECK(counted.whole().stretch(i).length == real.whole().stretch(i).length);
    }
    return worst;
}

}  // namespace

TEST_CASE("count spectrum: a block's power is that in double, to 17 bits of the largest line") {
    Noise random;
    for (double scale : {0.6, 3.0, 100.0, 5000.0, 40000.0}) {
        for (int shape = 0; shape < 6; ++shape) {
            std::int16_t x[256];
            float same[256];
            for (int i = 0; i < 256; ++i) {
                const double y = shape == 0   ? random()
                                 : shape == 1 ? (i % 2 ? 1 : -1)
                                 : shape == 2 ? (i / 2 % 2 ? 1 : -1)
                                 : shape == 3 ? (i == 77 ? 1 : 0)
                                 : shape == 4 ? (i < 128 ? 1 : -1)
                                              : 1;
                x[i] = counts_of(scale * y);
                same[i] = x[i];
            }
            BlockFft<Counts>::Work work;
            BlockFft<Reals>::Work real_work;
            const BlockFft<Counts>::Powers in_counts = BlockFft<Counts>::powers(x, 1, 127, work);
            const std::int64_t* const power = in_counts.power;
            const int places = in_counts.places;
            const double* const expected = BlockFft<Reals>::powers(same, 1, 127, real_work).power;
            const double largest = *std::max_element(expected, expected + 127);
            for (int i = 0; i < 127; ++i) {
                REQUIRE(power[i] >= 0);
                REQUIRE(power[i] < INT64_C(1) << 58);
                const double found = std::ldexp(static_cast<double>(power[i]), -2 * places);
                CHECK(std::fabs(std::sqrt(found) - std::sqrt(expected[i])) <= 1e-5 * std::sqrt(largest));
            }
        }
    }
}

TEST_CASE("count spectrum: its lines are those of the same samples in double, to a thousandth") {
    // The samples are white noise, a random walk that is pulled back to 0, both together, or white noise on a
    // drift. The drift is far larger than the range of the 16 bits in which the deepest level stores a
    // sample.
    for (int kind = 0; kind < 5; ++kind) {
        for (double deviation : {0.7, 1.6, 40.0}) {
            Noise random(static_cast<unsigned long long>(kind + 1));
            const float variance = static_cast<float>(deviation * deviation);
            std::unique_ptr<Pair> pair(new Pair);
            double walk = 0;
            for (int k = 0; k < 110000; ++k) {
                const double white = deviation * random();
                walk = 0.9995 * walk + 0.2 * deviation * random();
                const double y = kind == 0   ? white
                                 : kind == 1 ? walk + 0.5 * white
                                 : kind == 2 ? walk + white
                                 : kind == 3 ? white + 7
                                             : white + 0.0002 * k * deviation;
                pair->add(counts_of(y));
                if (kind == 3 && k % 9001 == 9000) pair->skip(1 + random.below(20));
            }
            const Difference worst = difference(*pair, static_cast<double>(variance));
            CAPTURE(kind);
            CAPTURE(deviation);
            CHECK(pair->counted.ladder().depth() >= 7);
            // In the integer spectrum, the values that replace lost samples are whole counts.
            CHECK(worst.bins < (kind == 3 ? 4e-3 : 1e-3));
            CHECK(worst.lines < 0.02);
            CHECK(worst.whole < 0.05);
            CHECK(pair->counted.counts().used == pair->gate.counts().used);
            CHECK(pair->counted.counts().bridged == pair->gate.counts().bridged);
        }
    }
}

TEST_CASE("count spectrum: a block with values that nobody measured is left out") {
    for (int lost : {0, 3}) {
        Noise random(2);
        std::unique_ptr<CountOctaves<>> octaves(new CountOctaves<>);
        for (int k = 0; k < 40000; ++k) {
            if (k == 20000 && lost > 0) octaves->skip(static_cast<std::uint64_t>(lost));
            octaves->add(counts_of(3 * random()));
        }
        float power[83], blocks, effective;
        octaves->ladder().sums(0, 0, power, &blocks, &effective);
        // The samples are 312 chunks, which give 311 overlapping blocks. The lost samples are in two of these
        // blocks.
        CHECK(blocks == 311 - (lost > 0 ? 2 : 0));
    }
}

TEST_CASE("count spectrum: knocks, steps and gaps are those that the gate finds in double") {
    Noise random(8);
    std::unique_ptr<Pair> pair(new Pair);
    double offset = 0;
    for (int k = 0; k < 120000; ++k) {
        if (k % 20000 == 19999) offset += 40;
        const bool knock = k % 7000 > 6950;
        pair->add(counts_of(offset + (knock ? 400 : 3) * random()));
        if (k % 11000 == 10999) pair->skip(1 + random.below(12));
    }
    const GateCounts& found = pair->counted.counts();
    const GateCounts& expected = pair->gate.counts();
    CHECK(found.knocks == expected.knocks);
    CHECK(found.knocked == expected.knocked);
    CHECK(found.steps == expected.steps);
    CHECK(found.gaps == expected.gaps);
    CHECK(found.limited == expected.limited);
    CHECK(found.knocks > 10);
    CHECK(found.steps > 0);
    CHECK(difference(*pair, 9.0).bins < 1e-3);
}

TEST_CASE("count spectrum: nothing overflows at the ends of the range") {
    for (int shape = 0; shape < 4; ++shape) {
        Noise random(4);
        CountOctaves<> octaves;
        std::uint64_t k = 0;
        for (; k < 150000; ++k) {
            const bool up = shape == 0   ? k % 2 == 0
                            : shape == 1 ? (k >> 7) % 2 == 0
                            : shape == 2 ? random.next() < 0.5
                                         : (k * k >> 16) % 2 == 0;
            octaves.add(up ? 32767 : -32768);
            if (k % 50000 == 0) octaves.skip(k);
        }
        CHECK(octaves.counts().taken == k);
        for (int l = 0; l < octaves.ladder().depth(); ++l) {
            float power[83], blocks, effective;
            octaves.ladder().sums(l, 0, power, &blocks, &effective);
            for (int i = 0; i < octaves.ladder().lines(l); ++i) {
                CHECK(power[i] >= 0);
                CHECK(power[i] < 3e38f);
            }
        }
    }
}

TEST_CASE("count spectrum: sums of the largest powers do not overflow in a century") {
    CountSums<2> sums;
    const std::int64_t largest = (INT64_C(1) << 58) - 1;
    const std::int64_t power[2] = {largest, largest / 1000};
    // A century at 1 kHz has 2^35 blocks, too many for a test. The 20,000 blocks here have the largest
    // possible power, so the unit of the sums has to be doubled again and again.
    for (int k = 0; k < 20000; ++k) sums.add(power, 6, 0);
    float read[2], blocks, effective;
    sums.read(0, read, &blocks, &effective);
    CHECK(blocks == 20000);
    CHECK(static_cast<double>(read[0]) == doctest::Approx(20000 * std::ldexp(1.0, 58 - 12)).epsilon(1e-6));
    CHECK(static_cast<double>(read[1]) == doctest::Approx(20 * std::ldexp(1.0, 58 - 12)).epsilon(1e-4));
    // Blocks with small powers still count in the sums if they come after blocks with large powers.
    CountSums<1> small;
    const std::int64_t one[1] = {INT64_C(1) << 20};
    for (int k = 0; k < 1000; ++k) small.add(one, 14, 0);
    float value;
    small.read(0, &value, &blocks, &effective);
    CHECK(value == doctest::Approx(1000.0 / 256));
}

TEST_CASE("count spectrum: what a block has of a unit is not lost when sums are large") {
    // The sums of both spectral lines share one unit. The first block's large power of one line makes it
    // 2^28. Every later block adds 0.3 of this unit to the other line.
    CountSums<2> sums;
    const std::int64_t first[2] = {INT64_C(1) << 57, 0},
                       rest[2] = {0, 3 * (INT64_C(1) << 57) / 10 / (INT64_C(1) << 29)};
    sums.add(first, 0, 0);
    for (int k = 0; k < 100000; ++k) sums.add(rest, 0, 0);
    float read[2], blocks, effective;
    sums.read(0, read, &blocks, &effective);
    CHECK(static_cast<double>(read[1]) == doctest::Approx(1e5 * static_cast<double>(rest[1])).epsilon(0.02));
}

TEST_CASE("count spectrum: values are the counts, to the ends of what a sensor says") {
    for (int y : {-32768, -20000, -1, 0, 5, 32767}) {
        for (int origin : {-32768, 0, 32767}) {
            CHECK(Counts::value(static_cast<std::int16_t>(y), static_cast<std::int16_t>(origin)) ==
                  (y - origin) * 1024);
        }
    }
    for (int l = 0; l < 11; ++l) CHECK(Counts::halvings(l + 1) == Counts::halvings(l) + Counts::finer(l));
}

TEST_CASE("count spectrum: a board that was turned far leaves no coarse unit behind") {
    // The sensor turns, but its rate changes so slowly that the gate, which leaves out disturbed samples,
    // finds neither a knock nor a step. After that, the sensor rests.
    Noise random(11);
    std::unique_ptr<Pair> pair(new Pair);
    const int turned = 40000;
    for (int k = 0; k < turned; ++k) {
        pair->add(counts_of(25000 * std::sin(6.283185307179586 * k / turned) + 1.6 * random()));
    }
    CHECK(pair->counted.counts().gaps == 0);
    CHECK(pair->counted.counts().knocks + pair->counted.counts().steps == 0);
    std::unique_ptr<Pair> before(new Pair(*pair));
    for (int k = 0; k < 110000; ++k) pair->add(counts_of(1.6 * random()));
    // Only the spectrum of the samples that came while the sensor rested is compared: the sums at the end
    // less those from before.
    for (int l = 0; l < 4; ++l) {
        float power[2][83], blocks[2], effective;
        double expected[2][83], real_blocks, real_effective;
        for (int i = 0; i < 2; ++i) {
            const Pair& one = i == 0 ? *before : *pair;
            one.counted.ladder().sums(l, 0, power[i], &blocks[i], &effective);
            one.real_ladder.sums(l, 0, expected[i], &real_blocks, &real_effective);
        }
        const int lines = pair->counted.ladder().lines(l);
        const double unit = std::ldexp(1.0, pair->counted.exponent(l));
        double found = 0, wanted = 0;
        for (int i = 0; i < lines; ++i) {
            found += (static_cast<double>(power[1][i]) - static_cast<double>(power[0][i])) * unit;
            wanted += expected[1][i] - expected[0][i];
        }
        CAPTURE(l);
        CHECK(found / wanted == doctest::Approx(1).epsilon(2e-3));
    }
}

TEST_CASE("count spectrum: an axis has a size that is known") { CHECK(sizeof(CountOctaves<>) <= 11800); }
