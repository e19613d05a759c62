// Tests of waits, due times and the numbers of sampling instants, also around the wrap of the clock.
#include <doctest/doctest.h>

#include <initializer_list>

#include "sampler.h"
#include "timers.h"

using fltea::Sampler;
using fltea::SamplingMode;

namespace {

constexpr uint64_t kPeriod = fltea::settings::kSamplePeriodUs;

uint32_t at(uint64_t us) { return static_cast<uint32_t>(us); }

// A Sampler in data-ready mode, for a sensor that has run since `start_us`.
struct Edged {
    Sampler sampler{SamplingMode::data_ready};
    explicit Edged(uint64_t start_us) {
        sampler.begin(at(start_us));
        sampler.sensor_runs(at(start_us));
    }
    bool edge(uint64_t us) {
        sampler.on_data_ready(at(us));
        return sampler.poll(at(us + 20));
    }
};

}  // namespace

TEST_CASE("pause: over from its end on, and once over it stays over while the clock wraps") {
    for (uint64_t start : {UINT64_C(0), kWrap - 50, kWrap - 100, kWrap / 2}) {
        fltea::Pause pause;
        CHECK(pause.over(at(start)));
        pause.begin(at(start), 100);
        CHECK_FALSE(pause.over(at(start)));
        CHECK_FALSE(pause.over(at(start + 99)));
        CHECK(pause.over(at(start + 100)));
        for (uint64_t us = start; us < start + 2 * kWrap; us += 10 * kPeriod) REQUIRE(pause.over(at(us)));
    }
}

TEST_CASE("every second: 10000 turns at their times through two wraps, none twice") {
    const uint64_t start = kWrap - 3300 * UINT64_C(1000000);
    fltea::EverySecond turn;
    turn.begin(at(start + 500000));
    uint64_t turns = 0;
    for (uint64_t us = start; us < start + UINT64_C(10000000000); us += 10000) {
        if (!turn.due(at(us))) continue;
        REQUIRE(us == start + 500000 + turns * 1000000);
        turn.done();
        ++turns;
    }
    CHECK(turns == 10000);
}

TEST_CASE("every second: polled late, the turns keep their phase") {
    fltea::EverySecond turn;
    turn.begin(0);
    uint32_t turns = 0;
    for (uint32_t us = 0; us < 1000000000; us += 7003) {
        if (!turn.due(us)) continue;
        REQUIRE(us - turns * 1000000 < 7003);
        turn.done();
        ++turns;
    }
    CHECK(turns == 1000);
}

TEST_CASE("every second: a turn waits until it is done, those that pass meanwhile are left out") {
    fltea::EverySecond turn;
    turn.begin(1000);
    CHECK_FALSE(turn.due(999));
    for (uint32_t us = 1000; us < 5000000; us += 10000) CHECK(turn.due(us));
    turn.done();
    CHECK_FALSE(turn.due(5000000));
    CHECK_FALSE(turn.due(5000999));
    CHECK(turn.due(5001000));
}

TEST_CASE("every second: still due after hours without being done") {
    fltea::EverySecond turn;
    turn.begin(0);
    for (uint64_t us = 0; us < 3 * kWrap; us += 50 * kPeriod) REQUIRE(turn.due(at(us)));
}

TEST_CASE("sampler: the first due time is the next multiple of the period") {
    for (uint32_t now : {0u, 1u, 9999u, 10000u, 123456u}) {
        CAPTURE(now);
        Sampler sampler(SamplingMode::timer);
        sampler.begin(now);
        sampler.sensor_runs(now);
        const uint32_t due = (now / 10000 + 1) * 10000;
        CHECK_FALSE(sampler.poll(due - 1));
        CHECK(sampler.poll(due));
        CHECK(sampler.due_us() == due);
        CHECK(sampler.sequence() == 0);
        CHECK_FALSE(sampler.poll(due));
    }
}

TEST_CASE("sampler: without drift over two wraps of the clock, with late and uneven polls") {
    const uint64_t start = kWrap - 1000 * kPeriod - 4321;
    Sampler sampler(SamplingMode::timer);
    sampler.begin(at(start));
    sampler.sensor_runs(at(start));
    const uint64_t first = (start / kPeriod + 1) * kPeriod;
    uint64_t instants = 0;
    uint64_t random = 1;
    for (uint64_t us = start; us < start + 2 * kWrap;) {
        if (sampler.poll(at(us))) {
            instants = (us - first) / kPeriod + 1;
            REQUIRE(sampler.due_us() == at(first + (instants - 1) * kPeriod));
            REQUIRE(sampler.sequence() == static_cast<uint16_t>(instants - 1));
        }
        random = random * 6364136223846793005u + 1442695040888963407u;
        us += (random >> 33) % 12000;
    }
    CHECK(instants > 850000);
}

TEST_CASE(
    "sampler: due times keep their phase to the board's timer when the sensor first runs after a wrap") {
    Sampler sampler(SamplingMode::timer);
    sampler.begin(0);
    uint64_t us = 0;
    for (; us < kWrap + 50 * kPeriod; us += kPeriod) REQUIRE_FALSE(sampler.poll(at(us)));
    REQUIRE_FALSE(sampler.poll(at(us)));
    sampler.sensor_runs(at(us));
    us += kPeriod;
    REQUIRE(sampler.poll(at(us)));
    CHECK(sampler.due_us() == at(us));
    CHECK(sampler.sequence() == 0);
    CHECK(sampler.overruns() == 0);
}

TEST_CASE("sampler: several instants in one go are all counted and the newest is announced") {
    Sampler sampler(SamplingMode::timer);
    sampler.begin(0);
    sampler.sensor_runs(0);
    CHECK(sampler.poll(10000));
    CHECK(sampler.poll(64000));
    CHECK(sampler.due_us() == 60000);
    CHECK(sampler.sequence() == 5);
    CHECK(sampler.overruns() == 4);
    sampler.missed();
    CHECK(sampler.overruns() == 5);
    CHECK_FALSE(sampler.poll(69999));
    CHECK(sampler.poll(70000));
    CHECK(sampler.sequence() == 6);
}

TEST_CASE("sampler: a burst that began a period or more late is the sample of a newer instant") {
    Sampler sampler(SamplingMode::timer);
    sampler.begin(0);
    sampler.sensor_runs(0);
    CHECK(sampler.poll(10000));
    sampler.burst_began(19999);
    CHECK(sampler.due_us() == 10000);
    CHECK(sampler.sequence() == 0);
    CHECK(sampler.overruns() == 0);
    CHECK(sampler.poll(20000));
    sampler.burst_began(70600);
    CHECK(sampler.due_us() == 70000);
    CHECK(sampler.sequence() == 6);
    CHECK(sampler.overruns() == 5);
    CHECK_FALSE(sampler.poll(70700));
    CHECK(sampler.poll(80000));
    CHECK(sampler.sequence() == 7);
    CHECK(sampler.overruns() == 5);
}

TEST_CASE("sampler: in timer mode edges mean nothing") {
    Sampler sampler(SamplingMode::timer);
    sampler.begin(0);
    sampler.sensor_runs(0);
    sampler.on_data_ready(5000);
    CHECK_FALSE(sampler.poll(5001));
    CHECK(sampler.silence_us(9999) == 0);
    CHECK(sampler.poll(10000));
    sampler.on_data_ready(10001);
    sampler.burst_began(10002);
    CHECK(sampler.due_us() == 10000);
    CHECK(sampler.sequence() == 0);
}

TEST_CASE(
    "edges: each is an instant with its own time, with a sensor clock one per cent off, through the wrap") {
    for (uint64_t period : {9900, 10000, 10100}) {
        const uint64_t start = kWrap - 700000 * period / 2;
        Edged edged(start);
        for (uint64_t n = 0; n < 700000; ++n) {
            const uint64_t us = start + 3000 + n * period;
            REQUIRE(edged.edge(us));
            REQUIRE(edged.sampler.due_us() == at(us));
            REQUIRE(edged.sampler.sequence() == static_cast<uint16_t>(n));
            REQUIRE_FALSE(edged.sampler.poll(at(us + 5000)));
        }
        CHECK(edged.sampler.overruns() == 0);
    }
}

TEST_CASE("edges: those of before the sensor ran do not count") {
    Sampler sampler(SamplingMode::data_ready);
    sampler.begin(0);
    sampler.on_data_ready(100);
    CHECK_FALSE(sampler.poll(200));
    sampler.sensor_runs(300);
    CHECK_FALSE(sampler.poll(400));
    sampler.on_data_ready(500);
    CHECK(sampler.poll(600));
    CHECK(sampler.sequence() == 0);
    CHECK(sampler.overruns() == 0);
}

TEST_CASE("edges: several that came in one go are all counted") {
    Edged edged(0);
    for (uint32_t us : {10000u, 20000u, 30000u}) edged.sampler.on_data_ready(us);
    CHECK(edged.sampler.poll(31000));
    CHECK(edged.sampler.due_us() == 30000);
    CHECK(edged.sampler.sequence() == 2);
    CHECK(edged.sampler.overruns() == 2);
}

TEST_CASE("edges: the time that one that got lost leaves is an instant too") {
    Edged edged(0);
    CHECK(edged.edge(10000));
    CHECK(edged.edge(20000));
    CHECK(edged.edge(40000));
    CHECK(edged.sampler.sequence() == 3);
    CHECK(edged.sampler.overruns() == 1);
    CHECK(edged.edge(59800));  // this edge comes 200 us early, because the sensor's clock is fast
    CHECK(edged.sampler.sequence() == 5);
    CHECK(edged.sampler.overruns() == 2);
}

TEST_CASE("edges: while the sensor stands still instants pass by time, none twice when edges come back") {
    for (uint64_t start : {UINT64_C(0), kWrap - 600 * kPeriod}) {
        for (uint64_t phase = 0; phase < 4 * kPeriod; phase += 500) {
            CAPTURE(phase);
            // time between calls of poll(): short or long
            const uint64_t step = phase < kPeriod ? 700 : 22000;
            Edged edged(start);
            CHECK(edged.edge(start + kPeriod));
            edged.sampler.sensor_stops();
            const uint64_t back = start + 1000 * kPeriod + phase;
            for (uint64_t us = start + kPeriod; us < back; us += step) {
                REQUIRE_FALSE(edged.sampler.poll(at(us)));
                REQUIRE(edged.sampler.silence_us(at(us)) == 0);
            }
            edged.sampler.sensor_runs(at(back));
            CHECK(edged.edge(back));
            const uint64_t number = (999 * kPeriod + phase + kPeriod / 2) / kPeriod;
            CHECK(edged.sampler.sequence() == number);
            CHECK(edged.sampler.overruns() == number - 1);
        }
    }
}

TEST_CASE("edges: silence counts from the last edge, or from where the sensor ran") {
    Edged edged(1000);
    CHECK(edged.sampler.silence_us(51000) == 50000);
    CHECK(edged.edge(60000));
    CHECK(edged.sampler.silence_us(60001) == 1);
}

TEST_CASE("edges: one that came before the burst began made its values; one that came after did not") {
    Edged edged(0);
    CHECK(edged.edge(10000));
    edged.sampler.on_data_ready(20000);
    edged.sampler.burst_began(20000);
    CHECK(edged.sampler.due_us() == 20000);
    CHECK(edged.sampler.sequence() == 1);
    CHECK(edged.sampler.overruns() == 1);
    CHECK_FALSE(edged.sampler.poll(20001));

    edged.sampler.on_data_ready(30000);
    edged.sampler.burst_began(29999);
    CHECK(edged.sampler.due_us() == 20000);
    CHECK(edged.sampler.poll(30001));
    CHECK(edged.sampler.due_us() == 30000);
}

TEST_CASE("sampler: instants are numbered on beyond what a SAMPLE's number holds") {
    Sampler sampler{SamplingMode::timer};
    sampler.begin(at(0));
    sampler.sensor_runs(at(0));
    for (uint32_t i = 0; i < 200000; ++i) {
        REQUIRE(sampler.poll(at((i + 1) * kPeriod)));
        REQUIRE(sampler.instant() == i);
        REQUIRE(sampler.sequence() == static_cast<uint16_t>(i));
    }
}
