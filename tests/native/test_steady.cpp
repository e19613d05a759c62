// What follows on the sample before it, and when it was. Python's rules are the oracle
// (tests/stream/test_steady.py); here it is that nothing changes where a sample does not, and the ends of the
// ranges.
#include <doctest/doctest.h>

#include "steady.hpp"

using namespace fltea;

namespace {

const FollowRule kAt100Hz = {10000, 10200, 300000000000, 1800000000000};
const SamplePlace kLast = {65535, 4294967000, 5000, 70000, 4294967000};

}  // namespace

TEST_CASE("steady: a sample follows over the wraps of its number and of the device's time") {
    SamplePlace place = kLast;
    REQUIRE(place.go_on(kAt100Hz, 0, 9704, 10005000));
    CHECK(place.seq == 70001);
    CHECK(place.epoch_us == 4294977000);
    CHECK(place.device_us == 9704);
}

TEST_CASE("steady: what does not follow changes nothing") {
    struct {
        std::int64_t sequence, device_us, host_ns;
    } const others[] = {
        {65535, 4294967000, 5000},           // the same again
        {1, 9704, 10005000},                 // one is missing
        {0, 9704 + 10201, 10005000},         // too late by the device's clock
        {0, 9704, 10005000 + 300000000001},  // by the host's
        {0, 9704, 1800000010000},            // after half an hour
    };
    for (const auto& other : others) {
        SamplePlace place = kLast;
        CHECK_FALSE(place.go_on(kAt100Hz, other.sequence, other.device_us, other.host_ns));
        CHECK(place.seq == kLast.seq);
        CHECK(place.host_ns == kLast.host_ns);
        CHECK(place.epoch_us == kLast.epoch_us);
    }
}

TEST_CASE("steady: Unix time follows the line, learns the earliest arrival, and never runs backwards") {
    SecondOfClock clock = {};
    clock.origin_ns = 1000;
    clock.offset_ns = 1700000000000000000;
    clock.centre_delay_s = 0.002;
    clock.slope = 1e-6;
    clock.last_ns = 0;
    CHECK(clock.time(2000000, 2005001000) == 1700000002002003000);
    CHECK(clock.any);
    CHECK(clock.earliest_delay_s == doctest::Approx(0.005));
    clock.time(2010000, 2012001000);
    CHECK(clock.earliest_s == doctest::Approx(2.01));
    clock.last_ns = 1800000000000000000;
    CHECK(clock.time(2020000, 2030000000) == 1800000000000000001);
    CHECK(clock.earliest_s == doctest::Approx(2.01));
}
