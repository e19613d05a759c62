// Tests of the octaves of a running spectrum. tests/spectrum compares their numbers with a computation in
// numpy. The tests here check accesses to memory, undefined behaviour, size, and that neither the division of
// samples into calls nor snapshots change the results.
#include <doctest/doctest.h>

#include <cmath>
#include <complex>
#include <cstring>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "noise.h"
#include "number_io.hpp"
#include "octave_peak.hpp"
#include "octaves.hpp"

using namespace fltea;
using engine::BlockFft;
using engine::Stretch;

namespace {

typedef Octaves<double> Lane;
typedef engine::OctaveLadder<RealSpectrum<double>> Ladder;
typedef engine::WholeStream<RealSpectrum<double>> WholeStream;

std::vector<double> noise(std::size_t n, unsigned long long seed = 42) {
    Noise next(seed);
    std::vector<double> y(n);
    for (double& one : y) one = next();
    return y;
}

void feed(Lane& lane, const std::vector<double>& y) { lane.add(y.data(), y.size(), 1); }

std::vector<double> saved(const Lane& lane) {
    std::unique_ptr<Lane> copy(new Lane(lane));
    std::vector<double> numbers;
    NumberSaver saver(numbers);
    copy->visit(saver);
    return numbers;
}

bool load(Lane& lane, const std::vector<double>& numbers) {
    NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    lane.visit(loader);
    return loader.sound() && loader.at_end();
}

// Reads all results of an octave spectrum.
void look(const Lane& lane) {
    std::unique_ptr<Lane> finished(new Lane(lane.finished()));
    const Ladder& ladder = finished->ladder();
    double power[Ladder::kTopLines], blocks, effective;
    for (int l = 0; l < ladder.depth(); ++l) {
        ladder.sums(l, finished->now(), power, &blocks, &effective);
        CHECK(blocks >= 0);
    }
    int sum = 0;
    for (int i = 0; i < ladder.whole().stretches(); ++i) sum += ladder.whole().stretch(i).length;
    CHECK(sum == ladder.whole().size());
    CHECK(sum <= WholeStream::kCapacity);
    finished->deepen();
}

}  // namespace

TEST_CASE("octaves: a lane has a size that is known") {
    CHECK(sizeof(Lane) <= 64 * 1024);
    CHECK(sizeof(Octaves<float>) <= 64 * 1024);
}

TEST_CASE("octaves: a block's power is that of its definition") {
    const std::vector<double> y = noise(256);
    double mean = 0;
    for (double one : y) mean += one / 256;
    BlockFft<RealSpectrum<double>>::Work work;
    BlockFft<RealSpectrum<float>>::Work single_work;
    const double* const power = BlockFft<RealSpectrum<double>>::powers(y.data(), 1, 127, work).power;
    const float* const single = BlockFft<RealSpectrum<float>>::powers(y.data(), 1, 127, single_work).power;
    for (int k = 1; k < 128; ++k) {
        std::complex<double> sum = 0;
        for (int t = 0; t < 256; ++t) {
            const double angle = 2 * 3.14159265358979323846 * t / 256;
            sum += std::polar((y[static_cast<std::size_t>(t)] - mean) * (0.5 - 0.5 * std::cos(angle)),
                              -angle * k);
        }
        CHECK(power[k - 1] == doctest::Approx(std::norm(sum)).epsilon(1e-9));
        CHECK(static_cast<double>(single[k - 1]) == doctest::Approx(std::norm(sum)).epsilon(1e-3));
    }
}

TEST_CASE("octaves: cuts change nothing, nor does looking") {
    for (double memory : {0.0, 700.0, 5000.0}) {
        Noise random(3);
        std::unique_ptr<Lane> once(new Lane(memory)), cut(new Lane(memory));
        for (int k = 0; k < 6; ++k) {
            std::vector<double> y = noise(5000, static_cast<unsigned long long>(k));
            const double jump = k % 3 == 1 ? 100 * k : 3 * k;
            for (std::size_t i = random.below(5000); i < y.size(); ++i) y[i] += jump;
            feed(*once, y);
            for (std::size_t at = 0; at < y.size();) {
                const std::size_t part = std::min(1 + random.below(700), y.size() - at);
                cut->add(y.data() + at, part, 1);
                at += part;
                look(*cut);
            }
            const std::size_t lost = random.below(12);
            once->skip(lost);
            for (std::size_t i = 0; i < lost; ++i) cut->skip(1);
        }
        CHECK(saved(*once) == saved(*cut));
    }
}

TEST_CASE("octaves: a stride takes one column") {
    std::vector<double> rows;
    const std::vector<double> y = noise(9000);
    for (double one : y) {
        rows.push_back(one);
        rows.push_back(-one);
    }
    std::unique_ptr<Lane> one(new Lane), other(new Lane);
    feed(*one, y);
    other->add(rows.data(), y.size(), 2);
    CHECK(saved(*one) == saved(*other));
}

TEST_CASE("octaves: many short stretches stay within their room") {
    for (double memory : {0.0, 600.0, 30000.0}) {
        Noise random(7);
        std::unique_ptr<Lane> lane(new Lane(memory));
        for (int k = 0; k < 3000; ++k) {
            feed(*lane, noise(1 + random.below(k % 100 == 0 ? 4000 : 130), 1));
            lane->skip(1 + random.below(k % 7 == 0 ? 100000 : 10));
            if (k % 50 == 0) look(*lane);
        }
        look(*lane);
    }
}

TEST_CASE("octaves: numbers at the ends of their range stay finite") {
    std::unique_ptr<Lane> lane(new Lane);
    Noise random(9);
    for (double scale : {1e99, 1e-300, 1.0, 1e30, 0.0, -1e99, 1e-40}) {
        for (int k = 0; k < 6000; ++k) {
            const double y = scale * random();
            lane->add(&y, 1, 1);
        }
        look(*lane);
        for (double one : saved(*lane)) CHECK(std::isfinite(one));
    }
}

TEST_CASE("octaves: a snapshot goes on with the same bits") {
    std::unique_ptr<Lane> lane(new Lane), restored(new Lane);
    feed(*lane, noise(20000));
    lane->skip(4);
    REQUIRE(load(*restored, saved(*lane)));
    CHECK(saved(*lane) == saved(*restored));
    feed(*lane, noise(7000, 2));
    feed(*restored, noise(7000, 2));
    CHECK(saved(*lane) == saved(*restored));
}

TEST_CASE("octaves: snapshots of strangers are refused or harmless") {
    Noise random(11);
    const double values[] = {-1,
                             0,
                             1,
                             2,
                             63,
                             64,
                             127,
                             128,
                             255,
                             256,
                             3071,
                             3072,
                             3073,
                             1e9,
                             1e15,
                             1e16,
                             1e300,
                             0.5,
                             std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity()};
    int taken = 0;
    for (std::size_t length : {100, 3000, 9000, 40000}) {
        for (double memory : {0.0, 2000.0}) {
            std::unique_ptr<Lane> lane(new Lane(memory));
            feed(*lane, noise(length));
            lane->skip(20);
            feed(*lane, noise(500));
            const std::vector<double> good = saved(*lane);
            for (std::size_t cut : {std::size_t(0), std::size_t(1), good.size() / 2, good.size() - 1}) {
                Lane other(memory);
                CHECK_FALSE(
                    load(other, std::vector<double>(good.begin(), good.begin() + static_cast<long>(cut))));
            }
            for (int k = 0; k < 150; ++k) {
                std::vector<double> bad = good;
                for (std::size_t i = 0; i <= random.below(3); ++i) {
                    // Wrong numbers are put at random places of a snapshot. Most of its numbers are samples;
                    // the others are mostly at its beginning and its end, so those places are chosen more
                    // often.
                    const std::size_t at =
                        k % 3 == 0   ? random.below(bad.size())
                        : k % 3 == 1 ? random.below(std::min<std::size_t>(60, bad.size()))
                                     : bad.size() - 1 - random.below(std::min<std::size_t>(3300, bad.size()));
                    bad[at] = values[random.below(sizeof values / sizeof values[0])];
                }
                std::unique_ptr<Lane> other(new Lane(memory));
                if (!load(*other, bad)) continue;
                ++taken;
                feed(*other, noise(4000));
                other->merge(*lane);
                feed(*other, noise(3000));
                look(*other);
            }
        }
    }
    CHECK(taken > 50);
}

TEST_CASE("octaves: a merge of any two stays within its room") {
    for (double memory : {0.0, 1000.0}) {
        for (std::size_t a : {0, 1, 200, 3072, 3073, 50000}) {
            for (std::size_t b : {0, 1, 200, 3072, 6000, 100000}) {
                std::unique_ptr<Lane> one(new Lane(memory)), other(new Lane(memory));
                feed(*one, noise(a));
                feed(*other, noise(b, 5));
                one->merge(*other);
                CHECK(one->counts().taken == a + b);
                CHECK(one->now() == a + b);
                look(*one);
                feed(*one, noise(5000, 6));
                look(*one);
            }
        }
    }
}

TEST_CASE("octaves: when the last level is full its oldest samples go") {
    typedef engine::OctaveLadder<RealSpectrum<double, 3>> Ladder;
    const unsigned char measured[128] = {};
    std::unique_ptr<Ladder> ladder(new Ladder);
    const std::vector<double> y = noise(128 * 400);
    std::uint64_t now = 0;
    for (int k = 0; k < 400; ++k, now += 128) {
        ladder->accept(y.data() + 128 * k, 128, now, measured);
        if (k == 150) ladder->cut();
        const Ladder::Whole& whole = ladder->whole();
        REQUIRE(whole.size() <= Ladder::Whole::kCapacity);
        REQUIRE(whole.stretches() > 0);
        const Stretch& last = whole.stretch(whole.stretches() - 1);
        // The last level (level 2) keeps its samples: every fourth one of the record. Its newest samples are
        // still missing, because the half-band filters need some later samples to compute them.
        if (k > 160) CHECK(last.first + 4 * static_cast<std::uint64_t>(last.length) + 128 > now);
    }
    CHECK(ladder->depth() == 2);
    CHECK(ladder->whole().size() > WholeStream::kCapacity - 64);
    double power[Ladder::kTopLines], blocks, effective;
    ladder->sums(0, now, power, &blocks, &effective);
    CHECK(blocks == 150 + 248);  // the spectrum of level 0 still has all blocks
    std::unique_ptr<Ladder> other(new Ladder(*ladder));
    other->cut();
    ladder->cut();
    ladder->merge(*other, now, 2 * now);
    CHECK(ladder->whole().size() <= WholeStream::kCapacity);
    CHECK(ladder->whole().stretch(ladder->whole().stretches() - 1).first > now);
}

TEST_CASE("octaves: what is dropped of a whole stream") {
    WholeStream whole;
    const std::vector<double> y = noise(3072);
    whole.add(y.data(), 3000, 0);
    whole.cut();
    whole.add(y.data(), 72, 5000);
    whole.drop_before(2990, 1);
    CHECK(whole.size() == 72);
    CHECK(whole.stretches() == 1);
    whole.drop_before(5010, 1);
    CHECK(whole.size() == 62);
    CHECK(whole.stretch(0).first == 5010);
    whole.cut();
    CHECK(whole.size() == 0);
}

TEST_CASE("octave peak: lines of any number are searched, and a strong one is found") {
    std::mt19937 random(5);
    for (std::size_t size = 0; size < 400; size += 1 + size / 7) {
        std::vector<double> power, weight;
        for (std::size_t i = 0; i < size; ++i) {
            weight.push_back(i < 60 ? 1 : 2.5);
            power.push_back(std::gamma_distribution<double>(weight[i], 1 / weight[i])(random));
        }
        fltea::peak::Search(power.data(), weight.data(), size).strongest(0.5);
        if (size < 80) continue;
        power[size / 2] = 1e3;
        const auto found = fltea::peak::Search(power.data(), weight.data(), size).strongest(1e-6);
        CHECK(found.any);
        CHECK(found.start <= size / 2);
        CHECK(found.stop > size / 2);
        CHECK(found.level < 10);
    }
}
