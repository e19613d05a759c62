// Tests of a device stream: position in the sequence, times, and stops. A stop is a return of the native
// code, for a reason that the caller has to handle. tests/stream/test_plain_device_stream.py compares the
// output with that of plain Python. These tests check the limits of ranges, and the order of stops.
#include <doctest/doctest.h>

#include <vector>

#include "device.hpp"

using namespace fltea;

namespace {

constexpr std::int64_t kMs = 1'000'000, kUnixNs = 1'700'000'000'000'000'000;

// Columns of samples at 100 Hz. The counts of each sample are the sample's number.
struct Samples {
    std::vector<std::int64_t> sequence, device_us, host_ns;
    std::vector<std::int16_t> gyro;

    Samples& add(std::int64_t first, std::int64_t end) {
        for (std::int64_t k = first; k < end; ++k) {
            sequence.push_back(k % 65536);
            device_us.push_back(k * 10'000 % (std::int64_t(1) << 32));
            host_ns.push_back(k * 10 * kMs);
            gyro.push_back(static_cast<std::int16_t>(k));
        }
        return *this;
    }
    SampleColumns columns() const {
        return {sequence.size(),
                sequence.data(),
                device_us.data(),
                host_ns.data(),
                NumberColumn(gyro.data(), NumberColumn::kCounts, 1),
                {},
                {},
                nullptr};
    }
};

struct Run {
    Device device;
    std::vector<char> room;
    std::vector<std::int64_t> seq, host_ns;
    std::vector<double> gyro_dps;

    Run() {
        device.place.on_hello(100, 50, true, true);
        device.scales = {2, false, 0, 1, 0};
    }
    Advanced advance(const SampleColumns& from, std::size_t at) {
        const Advanced found = device.advance(from, at, [this](std::size_t bytes) {
            room.assign(bytes, 0);
            return room.data();
        });
        for (std::size_t i = found.begin; i < found.end; ++i) {
            seq.push_back(device.run().seq[i]);
            host_ns.push_back(device.run().host_ns[i]);
            gyro_dps.push_back(device.run().gyro_dps[i]);
        }
        return found;
    }
    // Processes all samples, begins an epoch at each stop that asks for it, and returns all stops.
    std::vector<Stop> all(const SampleColumns& from) {
        std::vector<Stop> found;
        for (std::size_t at = 0;;) {
            const Advanced one = advance(from, at);
            found.push_back(one.stop);
            if (one.stop == Stop::kEnd) return found;
            if (one.stop == Stop::kEpoch) device.begin(kUnixNs, {});
            at = one.next;
        }
    }
};

}  // namespace

TEST_CASE("device: numbers and times go on over the wraps of the wire") {
    Run run;
    const std::int64_t last = (std::int64_t(1) << 32) / 10'000 + 70'000;
    for (std::int64_t k = 0; k < last; k += 10'000) {
        Samples some;
        run.all(some.add(k, k + 10'000).columns());
    }
    CHECK(run.device.place.counts().delivered == run.device.place.newest().seq + 1);
    CHECK(run.device.place.newest().epoch_us == run.device.place.newest().seq * 10'000);
    CHECK(run.device.place.counts().lost == 0);
}

TEST_CASE("device: an epoch waits for its beginning, and a gap is told before the sample behind it") {
    Run run;
    Samples some;
    some.add(5, 10).add(13, 15).add(100, 102);
    CHECK(run.all(some.columns()) ==
          std::vector<Stop>{Stop::kEpoch, Stop::kMore, Stop::kGap, Stop::kMore, Stop::kEpoch, Stop::kEnd});
    CHECK(run.seq == std::vector<std::int64_t>{5, 6, 7, 8, 9, 13, 14, 100, 101});
    CHECK(run.gyro_dps[5] == 6.5);
    CHECK(run.host_ns[5] == kUnixNs + 130 * kMs);
    CHECK(run.device.judged().missing == 85);
    CHECK(run.device.judged().reason == EpochReason::kGap);
    const PlaceCounts& counts = run.device.place.counts();
    CHECK(counts.delivered == 9);
    CHECK(counts.lost == 3 + 85);
    CHECK(counts.gaps == 2);
}

TEST_CASE("device: what does not follow is not believed") {
    Run run;
    Samples some;
    run.all(some.add(65'530, 65'536).columns());
    const Newest last = run.device.place.newest();
    struct {
        std::int64_t sequence, device_us, host_ns;
        bool follows;
    } const others[] = {
        {0, 655'360'000, 655'360 * kMs, true},
        // this sample does not follow directly: it has the same number as the last one
        {65'535, 655'350'000, 655'350 * kMs, false},
        {1, 655'370'000, 655'370 * kMs, false},  // this sample does not follow directly: one is missing
        // this sample follows directly: its delay by the device's clock is the largest allowed
        {0, 655'350'000 + 20'200, 655'360 * kMs, true},
        // one more us of delay by the device's clock: it does not follow
        {0, 655'350'000 + 20'201, 655'360 * kMs, false},
        // this sample follows directly: its delay by the host's clock is the largest allowed
        {0, 655'360'000, 655'360 * kMs + 300'000 * kMs, true},
        // one more ns of delay by the host's clock: this sample does not follow directly
        {0, 655'360'000, 655'360 * kMs + 300'000 * kMs + 1, false},
    };
    for (const auto& other : others)
        CHECK(run.device.place.follows(other.sequence, other.device_us, other.host_ns) == other.follows);
    CHECK(run.device.place.newest().seq == last.seq);
}

TEST_CASE("device: statistics stop before a sample, fits behind one, and each stop is told once") {
    Run run;
    Samples some;
    some.add(0, 30);
    const SampleColumns from = some.columns();
    CHECK(run.advance(from, 0).stop == Stop::kEpoch);
    run.device.begin(kUnixNs, {});
    run.device.stats_due_ns = 70 * kMs;
    run.device.fit_due = run.device.fit_counts = 20;
    Advanced found = run.advance(from, 0);
    CHECK(found.stop == Stop::kMore);
    CHECK(found.next == 7);
    CHECK(run.advance(from, 7).stop == Stop::kStatsDue);
    run.device.stats_due_ns = Device::kNever;
    found = run.advance(from, 7);
    CHECK(found.next == 21);
    CHECK(run.advance(from, 21).stop == Stop::kFitCounts);
    CHECK(run.advance(from, 21).stop == Stop::kFitDue);
    found = run.advance(from, 21);
    CHECK(found.stop == Stop::kEnd);
    CHECK(found.next == 30);
    CHECK(run.seq.size() == 30);
}

TEST_CASE("timebase: time learns the earliest arrival, and never runs backwards") {
    Timebase clock(kUnixNs);
    CHECK(clock.add(0, 0, 1000) == kUnixNs + 1000);
    CHECK(clock.add(1, 10'000, 15 * kMs) == kUnixNs + 10 * kMs + 1000);  // this sample arrives late
    // this sample's delay is a million ns shorter than that of any sample before
    CHECK(clock.add(2, 20'000, 19 * kMs) == kUnixNs + 19 * kMs);
    // this sample's own time would be before that of the previous sample, so it is set to 1 ns after that
    CHECK(clock.add(3, 20'500, 18 * kMs) == kUnixNs + 19 * kMs + 1);
    CHECK(clock.rate_hz() == doctest::Approx(3 / 0.0205));
    CHECK(std::isnan(clock.clock_ppm()));
}
