// Tests of the items and counts that the port decoder gives for bytes from the device's encoder.
#include <doctest/doctest.h>

#include <algorithm>
#include <limits>

#include "port_decoder_rig.hpp"

using namespace port_decoder_rig;

TEST_CASE("wire line: samples have the time of the read in which they ended") {
    Line line;
    const Bytes two = sample(2);
    Reads reads;
    reads.add(sample(1) + Bytes(two.begin(), two.begin() + 5), 10).add(Bytes(two.begin() + 5, two.end()), 20);
    reads.add(sample(3), 30);
    line.line.feed(reads.bytes.data(), reads.reads.data(), 3, 10);
    // No HELLO has come, so the decoder may have to report this between any two reads. It therefore returns
    // the samples of each read as an item of its own.
    for (std::int64_t k = 1; k < 4; ++k) {
        const PortItem item = line.line.next();
        REQUIRE(item.kind == PortItem::kSamples);
        REQUIRE(item.samples.n == 1);
        CHECK(item.samples.sequence[0] == k);
        CHECK(item.samples.device_us[0] == 10 * k);
        CHECK(item.samples.host_ns[0] == 10 * k);
        CHECK(item.samples.gyro[0] == static_cast<double>(k));
        CHECK(item.samples.accel[2] == 9.0);
        CHECK(item.samples.temperature[0] == -3.0);
        CHECK(item.samples.flags[0] == 4);
        CHECK(line.line.unix_offset_ns == 10 * k + 1);
    }
    CHECK(line.line.next().kind == PortItem::kDone);
    CHECK(line.line.next().kind == PortItem::kDone);
}

TEST_CASE("wire line: any other frame has the time of its read, too") {
    Line line;
    line.one(hello(), 1);
    Reads reads;
    reads.add(fault(), 20).add(Bytes{5, 1, 0}, 30).add(fault() + sample(0), 40).add(Bytes{1}, 50);
    line.line.feed(reads.bytes.data(), reads.reads.data(), 4, 20);
    for (std::int64_t at = 20; at <= 40; at += 10) {
        CHECK(line.line.next().host_ns == at);
        CHECK(line.line.unix_offset_ns == at + 1);
    }
    CHECK(line.line.next().kind == PortItem::kSamples);
    CHECK(line.line.unix_offset_ns == 41);
    CHECK(line.line.next().kind == PortItem::kDone);
    CHECK(line.line.unix_offset_ns == 51);
}

TEST_CASE("wire line: a known device's reads of one second are taken at once") {
    Line line;
    CHECK(line.one(hello(), 1) == Words{"frame 1"});
    Reads reads;
    reads.add(sample(1), 2).add(sample(2) + fault() + sample(3), 3).add(sample(4), kSecondNs / 3);
    CHECK(line.feed(reads) == Words{"2 samples", "frame 4", "2 samples"});
    const PortCounts& counts = line.line.counts();
    CHECK(counts.frames == 6);
    CHECK(counts.bytes == size_of(hello()) + size_of(reads.bytes));
    CHECK(line.line.unix_offset_ns == kSecondNs / 3 + 1);
    Reads seconds;
    seconds.add(sample(5), kSecondNs - 1).add(sample(6), kSecondNs).add(sample(7), kSecondNs + 1);
    seconds.add(sample(8), kSecondNs + kSecondNs / 2 + 2);
    CHECK(line.feed(seconds) == Words{"tick 833", "1 samples", "2 samples", "tick 1500", "1 samples"});
}

TEST_CASE("wire line: seconds before 0 are as long as others") {
    Line line;
    line.line.opened({-kSecondNs, 0});
    line.one(hello(), -kSecondNs);
    Reads reads;
    reads.add(sample(1), -kSecondNs * 6 / 10).add(sample(2), -kSecondNs / 10).add(sample(3), kSecondNs / 10);
    CHECK(line.feed(reads) == Words{"2 samples", "1 samples"});
}

TEST_CASE("wire line: samples are cut where their sequence does not follow") {
    Line line;
    line.one(hello(), 1);
    CHECK(line.one(sample(65534) + sample(65535) + sample(0) + sample(1) + sample(3) + sample(3), 2) ==
          Words{"2 samples", "2 samples", "1 samples", "1 samples"});
}

TEST_CASE("wire line: only what was handed on is counted") {
    Line line;
    line.one(hello(), 1);
    const Bytes bytes = sample(1) + sample(2) + fault() + Bytes{5, 1, 0} + sample(4);
    line.line.feed_one(bytes.data(), {size_of(bytes), {2, 0}}, 2);
    const PortCounts& counts = line.line.counts();
    for (const std::int64_t frames : {1, 3, 4}) {
        CHECK(line.line.next().kind != PortItem::kDone);
        CHECK(counts.frames == frames);
        CHECK(counts.bad.empty());
    }
    CHECK(line.line.next().kind == PortItem::kSamples);
    CHECK(counts.frames == 4);
    REQUIRE(counts.bad.size() == 1);
    CHECK(counts.bad[0].reason == Reason::cobs);
    CHECK(counts.bad[0].blocks == 1);
    CHECK(counts.bytes == size_of(hello()) + size_of(bytes) - size_of(sample(4)));
    CHECK(line.line.next().kind == PortItem::kDone);
    CHECK(counts.frames == 5);
}

TEST_CASE("wire line: only a HELLO that differs from the accepted one has to be looked at") {
    Line line;
    CHECK(line.one(hello() + hello() + hello(6) + hello(5), 1) ==
          Words{"frame 1", "same hello", "frame 1", "frame 1"});
    // A refused HELLO is forgotten: the next good one is compared with the last accepted one, and is the
    // same.
    CHECK(line.one(hello(13) + hello(13) + hello(5), 2) ==
          Words{"frame 1", "bad_hello", "frame 1", "same hello"});
    CHECK(line.line.counts().refused == 0);
}

TEST_CASE("wire line: nothing of a device that was refused is given, and all of it is counted") {
    Line line;
    CHECK(line.one(hello(5, kProtocolMajor + 1) + sample(0) + fault() + sample(1), 1) == Words{"version"});
    CHECK(line.line.counts().refused == 4);
    CHECK(line.line.counts().frames == 3);
    CHECK(line.one(hello(5, kProtocolMajor + 1), 2) == Words{"version again"});
    CHECK(line.one(hello(13) + sample(2), 3) == Words{"frame 1", "bad_hello"});
    CHECK(line.one(hello() + sample(3), 4) == Words{"frame 1", "1 samples"});
    CHECK(line.line.counts().refused == 6);
    line.line.opened({5, 5});
    CHECK(line.line.counts().connections == 2);
}

TEST_CASE("wire line: columns of a later second, and of later samples of a run") {
    Line line;
    line.one(hello(), 1);
    Reads reads;
    reads.add(sample(1), kSecondNs / 3).add(sample(2), kSecondNs / 2).add(sample(3), kSecondNs);
    reads.add(sample(4) + sample(7), kSecondNs + 1).add(sample(8), kSecondNs + 2);
    line.line.feed(reads.bytes.data(), reads.reads.data(), reads.reads.size(), kSecondNs / 3);
    CHECK(line.line.next().samples.n == 2);
    PortItem item = line.line.next();
    REQUIRE(item.samples.n == 2);
    CHECK(item.samples.host_ns[0] == kSecondNs);
    CHECK(item.samples.host_ns[1] == kSecondNs + 1);
    CHECK(line.line.counts().frames == 3);
    item = line.line.next();
    // next() has returned samples 3 and 4 in one item, and 7 and 8 in the next. counts() includes all four
    // only when the caller asks for the item after these.
    CHECK(line.line.counts().frames == 3);
    REQUIRE(item.samples.n == 2);
    CHECK(item.samples.host_ns[1] == kSecondNs + 2);
    CHECK(item.samples.gyro[3] == 8.0);
    CHECK(item.samples.accel[2] == 9.0);
    CHECK(item.samples.temperature[1] == -3.0);
    CHECK(line.line.next().kind == PortItem::kDone);
    CHECK(line.line.counts().frames == 7);
}

TEST_CASE("wire line: what was not taken is left out") {
    Line line;
    const Bytes bytes = hello() + sample(0) + fault();
    line.line.feed_one(bytes.data(), {size_of(bytes), {1, 0}}, 1);
    CHECK(line.line.next().type == Hello::type());
    line.line.accept_hello();
    line.line.silent(2);
    CHECK(line.line.counts().frames == 1);
    CHECK(line.all() == Words{"tick 0"});
    line.line.accept_hello();  // this has no effect, because no HELLO waits to be accepted
    CHECK(line.one(hello(), 3) == Words{"frame 1"});
    line.line.silent(5 * kSecondNs + 3);
    for (int k = 0; k < 9; ++k) CHECK(line.line.next().kind == PortItem::kTick);
    line.line.pass_time(0);
    // A tick is an item that only says that half a second has passed without bytes. next() has returned nine
    // of ten ticks, and pass_time() has discarded the tenth. So no item is left.
    CHECK(line.line.next().kind == PortItem::kDone);
    line.line.silent(5 * kSecondNs + 3);
    CHECK(line.line.next().kind == PortItem::kTick);
    line.line.pass_time(0);
    // After this only tick, next() would have checked whether it must report a silent port. pass_time() has
    // discarded this check.
    CHECK(line.line.next().kind == PortItem::kDone);
}

TEST_CASE("wire line: times at the ends of their range") {
    constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
    constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
    Line line;
    line.line.opened({kLeast, 0});
    line.line.resume(kLeast);
    CHECK(line.one(hello(), kLeast) == Words{"frame 1"});
    Reads reads;
    reads.add(sample(1), kLeast).add(sample(2), kLeast + 1).add(sample(3), kMost).add(sample(4), kMost);
    const Words found = line.feed(reads);
    CHECK(found.front() == "2 samples");
    CHECK(found.back() == "2 samples");
    line.line.pass_time(kLeast);
    CHECK(line.all() == Words{});
    CHECK(line.silent(kMost).size() == 1);
    line.silent(kLeast);
}

TEST_CASE("wire line: whatever the reads, the same frames and counts") {
    Bytes stream;
    for (std::uint16_t k = 0; k < 60; ++k) {
        stream = stream + sample(k);
        if (k % 9 == 0) stream = stream + hello(k / 20u + 1) + fault();
        if (k % 7 == 0) stream = stream + Bytes{3, 9, 0};
    }
    for (std::size_t step = 1; step < 90; ++step) {
        CAPTURE(step);
        Line line;
        Reads reads;
        for (std::size_t at = 0; at < stream.size(); at += step) {
            const std::size_t end = std::min(at + step, stream.size());
            reads.add(Bytes(stream.begin() + static_cast<long>(at), stream.begin() + static_cast<long>(end)),
                      static_cast<std::int64_t>(at) * 10'000);
        }
        std::int64_t next = 0, others = 0;
        line.line.feed(reads.bytes.data(), reads.reads.data(), reads.reads.size(), 0);
        for (PortItem item = line.line.next(); item.kind != PortItem::kDone; item = line.line.next()) {
            if (item.kind == PortItem::kFrame && item.type == Hello::type()) line.line.accept_hello();
            if (item.kind != PortItem::kSamples) ++others;
            for (std::size_t i = 0; item.kind == PortItem::kSamples && i < item.samples.n; ++i)
                CHECK(item.samples.sequence[i] == next++);
        }
        CHECK(next == 60);
        CHECK(others == 7 + 7 + 9);
        CHECK(line.line.counts().frames == 60 + 14);
        CHECK(line.line.counts().bytes == size_of(stream));
    }
}
