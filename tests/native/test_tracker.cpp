// Tests of the classes of which the tracker of the bias consists. tests/estimator compares its numbers with a
// filter in numpy. The tests here check accesses to memory, undefined behaviour, hostile snapshots, and the
// rules of single classes.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "noise.h"
#include "number_io.hpp"
#include "one_axis.hpp"

using namespace fltea;
using namespace fltea::track;

namespace {

typedef System<kMost> Any;

const double kNone = std::numeric_limits<double>::quiet_NaN();

// Returns a state-space model of noise with a pair of complex poles, relaxations and an offset. It has n
// states, and n is larger than 3.
Any system_of(int n, unsigned long long seed) {
    Noise random(seed);
    Any s = Any();
    s.n = n;
    s.pairs = 1;
    s.R = 1;
    const double size = 0.5 + 0.4 * random.next(), turn = 3 * random.next();
    s.a[0] = s.a[1] = size * std::cos(turn);
    s.b[0] = s.b[1] = size * std::sin(turn);
    for (int i = 0; i < n; ++i) {
        if (i >= 2) s.a[i] = i == n - 1 ? 1 : 1 - std::pow(10, -3 * random.next());
        s.c[i] = s.bias[i] = 1;
        s.state[i] = i == n - 1 ? 0 : 1;
        s.Q[i * n + i] = i == n - 1 ? 0 : 0.01 + 0.1 * random.next();
        s.P0[i * n + i] = i == n - 1 ? 1e4 : 1;
    }
    return s;
}

std::vector<double> saved(OneAxis& one) {
    std::vector<double> numbers;
    NumberSaver saver(numbers);
    one.visit(saver);
    return numbers;
}

bool load(OneAxis& one, const std::vector<double>& numbers) {
    NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    one.visit(loader);
    return loader.sound() && loader.at_end();
}

// Returns sample i of a series with rest, single large values (knocks), motion, and a step of the bias.
double sample(Noise& random, int i) {
    double y = random();
    if (i % 400 == 50) y += 1e4;
    if (i % 1000 > 700 && i % 1000 < 800) y += 100 * std::sin(i * 0.1);
    return i > 600 ? y + 50 : y;
}

bool sane(const Tracked& one) {
    const auto fine = [](double x) { return std::isnan(x) || std::fabs(x) < 1e300; };
    return fine(one.bias) && fine(one.bias_std) && fine(one.state) && fine(one.state_std) &&
           fine(one.innovation) && !(one.bias_std < 0) && !(one.state_std < 0);
}

std::unique_ptr<OneAxis> made(bool modelled, const double* offset = nullptr) {
    TrackerRules rules;
    rules.ahead = 30;
    rules.checked[0] = 50;
    rules.largest_step = 60;
    std::unique_ptr<OneAxis> one(new OneAxis(offset, rules));
    if (modelled) {
        // Two candidate state-space models. They differ in the last state, the offset: in one model it does a
        // random walk, in the other it is constant.
        const Any stays = system_of(6, 1);
        Any walks = stays;
        walks.Q[35] = 1e-3;
        CHECK(one->set({walks, stays}, {0.4, 0.6}));
    }
    return one;
}

}  // namespace

TEST_CASE("tracker: a map is so many single steps") {
    for (int n : {3, 4, 8, 16, 24}) {
        std::unique_ptr<Any> s(new Any(system_of(n, static_cast<unsigned long long>(n))));
        std::unique_ptr<RiccatiMap<kMost>> map(new RiccatiMap<kMost>);
        REQUIRE(map->set(*s));
        std::vector<double> P(s->P0, s->P0 + n * n), by_map(P);
        map->apply(by_map.data());
        for (int k = 0; k < RiccatiMap<kMost>::kSamples; ++k) {
            std::vector<double> K(static_cast<std::size_t>(n));
            for (int i = 0; i < n; ++i)
                K[static_cast<std::size_t>(i)] = dot(&P[static_cast<std::size_t>(i * n)], s->c, n);
            const double S = dot(K.data(), s->c, n) + s->R;
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) {
                    P[static_cast<std::size_t>(i * n + j)] -=
                        K[static_cast<std::size_t>(i)] * K[static_cast<std::size_t>(j)] / S;
                }
            }
            s->step_covariance(P.data());
        }
        for (std::size_t i = 0; i < P.size(); ++i) CHECK(by_map[i] == doctest::Approx(P[i]).epsilon(1e-6));
    }
}

TEST_CASE("tracker: a system without state variables") {
    OneAxis one;
    Any s = Any();
    s.R = 2;
    REQUIRE(one.set(s));
    Noise random;
    for (int i = 0; i < 2000; ++i) {
        const Tracked found = one.next(random());
        CHECK(found.state == 0);
        CHECK(found.bias_std == 0);
    }
}

TEST_CASE("tracker: what is singular is solved, or not") {
    double M[4] = {0, 2, 3, 0}, Y[2] = {4, 6};
    CHECK(solve(M, Y, 2, 1));
    CHECK(Y[0] == 2);
    CHECK(Y[1] == 2);
    double none[4] = {1, 2, 2, 4};
    CHECK(!solve(none, Y, 2, 1));
}

TEST_CASE("tracker: the past keeps means, and what is not known is not in them") {
    std::unique_ptr<Past> past(new Past);
    float group[Past::kGroup];
    const int groups = 600000 / Past::kGroup;
    for (int k = 0; k < groups; ++k) {
        for (int i = 0; i < Past::kGroup; ++i) group[i] = k % 2 == 0 && i < 20 ? NAN : float(k);
        past->add(group);
    }
    CHECK(past->single().full());
    CHECK(past->single()[Past::kSingle - 1] == groups - 1);
    int kept = past->single().count(), size = Past::kGroup;
    for (int level = 0; level < Past::kLevels; ++level, size *= Past::kGroup) {
        const Newest<Past::kMeans>& means = past->means(level);
        kept += means.count() * size;
        for (int i = 2; i < means.count(); ++i) {
            // The mean of a group of 32 samples is unknown (NaN) if more than half of them are unknown.
            if (level == 0 && std::isnan(means[i])) CHECK(std::isnan(means[i - 2]));
            if (level == 0 && !std::isnan(means[i])) CHECK(means[i] == means[i - 2] + 2);
            if (level > 0) CHECK(means[i] > means[i - 1]);
        }
    }
    CHECK(kept == groups * Past::kGroup);
}

TEST_CASE("tracker: the gate sees knocks and spikes, and no step in them") {
    RestGate gate;
    Noise random;
    const double far = std::numeric_limits<double>::infinity();
    const auto chunk = [&](double mean, double scale, double largest_step) {
        for (int i = 0; i < RestGate::kChunk; ++i) {
            const double y = mean + scale * random();
            gate.add(y, y, 1);
        }
        return gate.end_chunk(1, 0, largest_step, false);
    };
    for (int k = 0; k < 1000; ++k) REQUIRE(!chunk(0, 1, far).knock);
    CHECK(chunk(0, 9, far).knock);
    CHECK(!chunk(0, 1, far).knock);
    CHECK(gate.add(101, 101, 1));
    CHECK(!gate.add(99, 99, 1));
    gate = RestGate();
    CHECK(chunk(5, 1, 4).knock);
    CHECK(!chunk(5, 1, 6).knock);
    const ChunkVerdict lies = chunk(5, 1, 6);
    CHECK(lies.same_place);
    CHECK(lies.place == doctest::Approx(5).epsilon(0.2));
    CHECK(!chunk(12, 1, far).same_place);
    Usual usual;
    usual.power = 400;
    usual.mean = 400;
    gate = RestGate();
    gate.expect(usual);
    for (int k = 0; k < 100; ++k) REQUIRE(!chunk(k % 2 == 0 ? 4.5 : -4.5, 15, far).knock);
    CHECK(chunk(0, 180, far).knock);
}

TEST_CASE("tracker: the accelerometer shows a tilt, and rest where it ends") {
    GravityGate gate;
    Noise random;
    bool moving = false;
    const auto chunk = [&](double tilt) {
        for (int i = 0; i < 32; ++i) {
            const double y[3] = {tilt + 0.02 * random(), 0.02 * random(), 9.8 + 0.02 * random()};
            gate.add(y, 3);
        }
        return moving = gate.end_chunk(0.1, moving);
    };
    for (int k = 0; k < 300; ++k) REQUIRE(!chunk(1e-4 * k));  // the bias drifts slowly, which is no motion
    CHECK(chunk(0.5));
    CHECK(chunk(0.7));
    CHECK(!chunk(0.7));
    CHECK(!chunk(0.7));
}

TEST_CASE("tracker: a step is seen, a glitch and a drift are none") {
    Noise random(21);
    const auto first = [&](StepTest& test, int n, double step, double slope, double glitch) {
        StepSeen seen = {StepSeen::kNothing, 0, 0};
        for (int i = 0; i < n && seen.kind == StepSeen::kNothing; ++i) {
            seen = test.add(random() + step + slope * i + (i % 100 == 50 ? glitch : 0));
        }
        return seen;
    };
    std::unique_ptr<StepTest> test(new StepTest);
    CHECK(first(*test, 50000, 0, 0, 30).kind == StepSeen::kNothing);
    const StepSeen step = first(*test, 400, 1, 0, 0);
    CHECK(step.kind == StepSeen::kStep);
    CHECK(step.ago < 150);
    CHECK(step.size == doctest::Approx(1).epsilon(0.5));
    test->clear();
    CHECK(test->suspected().likely == 0);
    CHECK(first(*test, 20000, 0, 2e-5, 0).kind == StepSeen::kDrift);
}

TEST_CASE("tracker: the mean of what comes is a sum of single steps") {
    for (int n : {3, 8}) {
        std::unique_ptr<Any> s(new Any(system_of(n, 5)));
        s->Q[n * n - 1] = 0.01;
        for (long long m : {1, 2, 7, 100}) {
            const MeanAhead<kMost> found = mean_ahead(*s, s->bias, m);
            for (int i = 0; i < n; ++i) {
                double x[kMost] = {}, sum = 0;
                x[i] = 1;
                for (long long k = 0; k < m; ++k) {
                    s->step(x);
                    sum += dot(s->bias, x, n);
                }
                CHECK(found.row[i] == doctest::Approx(sum / double(m)).epsilon(1e-9));
            }
            // Future noise makes the mean bias uncertain. The variance of this is compared, too.
            std::vector<double> weight(s->bias, s->bias + n), all(weight);
            double variance = 0;
            for (long long k = 0; k < m; ++k) {
                variance += form(all.data(), s->Q, all.data(), n);
                std::vector<double> next(static_cast<std::size_t>(n));
                for (int i = 0; i < n; ++i) {
                    double x[kMost] = {};
                    x[i] = 1;
                    s->step(x);
                    next[static_cast<std::size_t>(i)] = dot(all.data(), x, n) + s->bias[i];
                }
                all = next;
            }
            CHECK(found.variance == doctest::Approx(variance / double(m * m)).epsilon(1e-9));
        }
    }
}

TEST_CASE("tracker: what was saved goes on to the bit") {
    for (bool modelled : {false, true}) {
        for (int at : {0, 1, 15, 16, 40, 52, 66, 330, 705, 750, 801, 1000, modelled ? 3000 : 1100}) {
            Noise random(3);
            std::unique_ptr<OneAxis> one = made(modelled), other = made(false);
            for (int i = 0; i < at; ++i) one->next(sample(random, i));
            REQUIRE(load(*other, saved(*one)));
            for (int i = at; i < at + 200; ++i) {
                if (i % 150 == 149) {
                    one->skip(3);
                    other->skip(3);
                }
                const double y = sample(random, i);
                one->next(y);
                other->next(y);
            }
            CHECK(saved(*one) == saved(*other));
        }
    }
}

TEST_CASE("tracker: snapshots of strangers are refused, or are such as can go on") {
    for (bool modelled : {false, true}) {
        Noise random(5), noise(6);
        std::unique_ptr<OneAxis> one = made(modelled);
        for (int i = 0; i < (modelled ? 3000 : 700); ++i) one->next(sample(noise, i));
        const std::vector<double> good = saved(*one);
        const double values[] = {kNone, INFINITY, -1,    0,    0.5,   1,     2,
                                 31,    1e9,      -1e99, 1e99, 1e150, 1e200, 1e308};
        int accepted = 0;
        const int runs = modelled ? 2000 : 300;
        for (int k = 0; k < runs; ++k) {
            std::vector<double> hostile = good;
            const std::size_t changes = 1 + random.below(3);
            for (std::size_t i = 0; i < changes; ++i) {
                const bool early = random.next() < 0.7;
                hostile[random.below(early ? 1300 : hostile.size())] = values[random.below(14)];
            }
            if (k % 10 == 9) hostile.resize(random.below(hostile.size()));
            std::unique_ptr<OneAxis> other = made(false);
            if (!load(*other, hostile)) continue;
            ++accepted;
            for (int i = 0; i < 80; ++i) other->next(sample(noise, i));
            other->skip(70);
            other->set(system_of(5, 2));
            for (int i = 0; i < 40; ++i) other->next(sample(noise, i));
            saved(*other);
        }
        CHECK(accepted > 0);
        CHECK(accepted < runs);
    }
}

TEST_CASE("tracker: numbers at the ends of their range stay finite") {
    for (bool modelled : {false, true}) {
        const double offset = 3;
        std::unique_ptr<OneAxis> one = made(modelled, modelled ? nullptr : &offset);
        Noise random(9);
        for (double scale : {1e99, 1e-300, 1.0, 1e30, 0.0, -1e99, 1e-40}) {
            for (int i = 0; i < 200; ++i) CHECK(sane(one->next(scale * random())));
            one->skip(random.below(100));
        }
        std::unique_ptr<OneAxis> other = made(false);
        CHECK(load(*other, saved(*one)));
    }
}

TEST_CASE("tracker: another system is no jump of what does not depend on it") {
    Noise random(11);
    std::unique_ptr<OneAxis> one = made(false);
    for (int i = 0; i < 1000; ++i) one->next(5 + random());
    for (int n : {3, 6, 24, 4}) {
        REQUIRE(one->set(system_of(n, 7)));
        for (int i = 0; i < 100; ++i) {
            const Tracked found = one->next(5 + random());
            CHECK(sane(found));
            CHECK(found.bias == doctest::Approx(5).epsilon(0.5));
        }
        CHECK(std::isfinite(one->axis().memory().likelihood(system_of(n, 8))));
    }
    CHECK(std::isnan(one->axis().likelihood()));
}

TEST_CASE("tracker: gaps of every length") {
    for (bool modelled : {false, true}) {
        std::unique_ptr<OneAxis> one = made(modelled);
        one->skip(100);  // 100 samples are lost before the first sample
        Noise random(13);
        for (std::uint64_t lost : {0, 1, 31, 32, 33, 500, 3000, 100001}) {
            for (int i = 0; i < 100; ++i) CHECK(sane(one->next(random())));
            if (modelled || lost < 600 || lost > AxisTracker::kLongestGap) one->skip(lost);
        }
        CHECK(one->axis().counts().begun == 0);
    }
}
