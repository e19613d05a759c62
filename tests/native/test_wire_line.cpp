// A wire's items, counts and watch, by bytes that the device's encoder makes.
#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "frame.h"
#include "wire_line.hpp"

using namespace fltea;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Words = std::vector<std::string>;

constexpr std::int64_t kMs = 1'000'000;
constexpr LineTimes kTimes = {5 * kSecondNs, kSecondNs / 2, 60 * kSecondNs};

Bytes frame(std::uint8_t type, const Bytes& payload, std::uint16_t sequence = 0) {
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_frame(type, sequence, 7, payload.data(), payload.size(), wire);
    return Bytes(wire, wire + n);
}

Bytes sample(std::uint16_t sequence) {
    Sample one = {};
    one.gyro_x = static_cast<std::int16_t>(sequence);
    one.accel_z = 9;
    one.temperature = -3;
    one.flags = 4;
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_message(one, sequence, sequence * 10u, wire);
    return Bytes(wire, wire + n);
}

Bytes hello(std::uint32_t boot = 5, std::uint8_t major = kProtocolMajor) {
    Hello one = {};
    one.protocol_major = major;
    one.protocol_minor = kProtocolMinor;
    one.schema_hash = kSchemaHash;
    one.boot_id = boot;
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_message(one, 0, 0, wire);
    return Bytes(wire, wire + n);
}

Bytes fault() { return frame(Fault::type(), Bytes(Fault::size(), 1)); }

Bytes operator+(Bytes one, const Bytes& other) {
    one.insert(one.end(), other.begin(), other.end());
    return one;
}

// The offset is one more than the time, or as large as can be.
Stamp stamp(std::int64_t host_ns) {
    return {host_ns, host_ns == std::numeric_limits<std::int64_t>::max() ? host_ns : host_ns + 1};
}

struct Reads {
    Bytes bytes;
    std::vector<PortRead> reads;

    Reads& add(const Bytes& of_read, std::int64_t host_ns) {
        bytes = bytes + of_read;
        reads.push_back({static_cast<std::int64_t>(bytes.size()), stamp(host_ns)});
        return *this;
    }
};

// A line that was opened at 0. What it gives as words: what, and when or how many; HELLOs of boot 13 are
// refused.
struct Line {
    WireLine line{kTimes};

    Line() { line.opened({0, 1}); }

    Words all() {
        Words found;
        for (LineItem item = line.next(); item.kind != LineItem::kDone; item = line.next()) {
            found.push_back(word(item));
            if (item.kind == LineItem::kFrame && item.type == Hello::type()) judge(item, found);
        }
        return found;
    }
    Words feed(const Reads& reads) {
        line.feed(reads.bytes.data(), reads.reads.data(), reads.reads.size(), reads.reads[0].stamp.host_ns);
        return all();
    }
    Words one(const Bytes& bytes, std::int64_t host_ns) {
        line.feed_one(bytes.data(), {static_cast<std::int64_t>(bytes.size()), stamp(host_ns)}, host_ns);
        return all();
    }
    Words silent(std::int64_t now_ns) {
        line.silent(now_ns);
        return all();
    }
    // The troubles of a silence until now.
    Words troubles(std::int64_t now_ns) {
        Words found;
        for (const std::string& one : silent(now_ns)) {
            if (one.compare(0, 4, "tick") != 0) found.push_back(one);
        }
        return found;
    }

  private:
    void judge(const LineItem& item, Words& found) {
        if (item.bytes[6] != 13) {
            line.accept_hello();
        } else if (line.refuse_hello()) {
            found.push_back("bad_hello");
        }
    }

    static std::string word(const LineItem& item) {
        switch (item.kind) {
            case LineItem::kDone:
                return "done";
            case LineItem::kSamples:
                return std::to_string(item.samples.n) + " samples";
            case LineItem::kFrame:
                return "frame " + std::to_string(item.type);
            case LineItem::kSameHello:
                return "same hello";
            case LineItem::kRefusedVersion:
                return item.is_news ? "version" : "version again";
            case LineItem::kBad:
                return reason_name(item.reason);
            case LineItem::kTick:
                return "tick " + std::to_string(item.host_ns / kMs);
            case LineItem::kTrouble:
                return trouble_name(item.trouble) + (" " + std::to_string(item.host_ns / kMs));
        }
        return "";
    }
};

std::int64_t size_of(const Bytes& bytes) { return static_cast<std::int64_t>(bytes.size()); }

}  // namespace

TEST_CASE("wire line: samples have the time of the read in which they ended") {
    Line line;
    const Bytes two = sample(2);
    Reads reads;
    reads.add(sample(1) + Bytes(two.begin(), two.begin() + 5), 10).add(Bytes(two.begin() + 5, two.end()), 20);
    reads.add(sample(3), 30);
    line.line.feed(reads.bytes.data(), reads.reads.data(), 3, 10);
    // No HELLO was heard, so reads are taken one by one: a trouble might be due between them.
    for (std::int64_t k = 1; k < 4; ++k) {
        const LineItem item = line.line.next();
        REQUIRE(item.kind == LineItem::kSamples);
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
    CHECK(line.line.next().kind == LineItem::kDone);
    CHECK(line.line.next().kind == LineItem::kDone);
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
    CHECK(line.line.next().kind == LineItem::kSamples);
    CHECK(line.line.unix_offset_ns == 41);
    CHECK(line.line.next().kind == LineItem::kDone);
    CHECK(line.line.unix_offset_ns == 51);
}

TEST_CASE("wire line: a known device's reads of one second are taken at once") {
    Line line;
    CHECK(line.one(hello(), 1) == Words{"frame 1"});
    Reads reads;
    reads.add(sample(1), 2).add(sample(2) + fault() + sample(3), 3).add(sample(4), kSecondNs / 3);
    CHECK(line.feed(reads) == Words{"2 samples", "frame 4", "2 samples"});
    const LineCounts& counts = line.line.counts();
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
    const LineCounts& counts = line.line.counts();
    for (const std::int64_t frames : {1, 3, 4}) {
        CHECK(line.line.next().kind != LineItem::kDone);
        CHECK(counts.frames == frames);
        CHECK(counts.bad.empty());
    }
    CHECK(line.line.next().kind == LineItem::kSamples);
    CHECK(counts.frames == 4);
    REQUIRE(counts.bad.size() == 1);
    CHECK(counts.bad[0].reason == Reason::cobs);
    CHECK(counts.bad[0].blocks == 1);
    CHECK(counts.bytes == size_of(hello()) + size_of(bytes) - size_of(sample(4)));
    CHECK(line.line.next().kind == LineItem::kDone);
    CHECK(counts.frames == 5);
}

TEST_CASE("wire line: only a HELLO that differs from the accepted one has to be looked at") {
    Line line;
    CHECK(line.one(hello() + hello() + hello(6) + hello(5), 1) ==
          Words{"frame 1", "same hello", "frame 1", "frame 1"});
    // What was refused is not what was accepted last.
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

TEST_CASE("wire line: a silence is told, again after a minute, and anew after a HELLO") {
    Line line;
    CHECK(line.silent(kSecondNs / 2 - 1) == Words{"tick 499"});
    CHECK(line.troubles(5 * kSecondNs - 1) == Words{});
    CHECK(line.troubles(5 * kSecondNs) == Words{"silent 5000"});
    CHECK(line.troubles(65 * kSecondNs) == Words{});
    CHECK(line.troubles(66 * kSecondNs) == Words{"silent 65500"});
    line.one(hello(), 70 * kSecondNs);
    CHECK(line.troubles(75 * kSecondNs) == Words{"silent 75000"});
}

TEST_CASE("wire line: a silence between reads is told before what broke it") {
    Line line;
    line.one(hello(), 1);
    Reads reads;
    const Words found = line.feed(reads.add(sample(1), 2).add(sample(2), 6 * kSecondNs + 2));
    REQUIRE(found.size() == 1 + 11 + 1 + 1);
    CHECK(found[10] == "tick 5000");
    CHECK(found[11] == "silent 5000");
    CHECK(found[12] == "tick 5500");
}

TEST_CASE("wire line: a long silence has at most so many ticks") {
    Line line;
    CHECK(line.silent(kSecondNs) == Words{"tick 500", "tick 1000"});
    line.line.pass_time(2 * kSecondNs);
    CHECK(line.all() == Words{"tick 1500"});
    line.line.failed("unplugged", {3 * kSecondNs, 1});
    CHECK(line.silent(7 * kSecondNs / 2) == Words{"tick 3500"});
    CHECK(line.silent(3000 * kSecondNs).size() == 120);
}

TEST_CASE("wire line: bytes without frames for five seconds are no device of ours") {
    Line line;
    Reads reads;
    for (std::int64_t k = 1; k < 12; ++k) reads.add(Bytes(100, 0x55), k * kSecondNs / 2);
    const Words found = line.feed(reads);
    CHECK(found == Words{"partial", "no_valid_frame 5500"});
    // The same is not told again, another trouble is.
    CHECK(line.one(Bytes{0} + sample(0), 6 * kSecondNs) == Words{"1 samples", "no_hello 6000"});
}

TEST_CASE("wire line: unread bytes count from the read behind the last good frame") {
    Line line;
    line.one(hello(), 1);
    Reads reads;
    reads.add(sample(1), 2).add(Bytes(7, 1), 3).add(Bytes(5, 1), 4);
    CHECK(line.feed(reads) == Words{"1 samples"});
    for (std::int64_t k = 1; k < 10; ++k) line.one(Bytes(1, 1), k * kSecondNs / 2);
    CHECK(line.one(Bytes(1, 1), 5 * kSecondNs + 2) == Words{});
    const Bytes last(1, 1);
    line.line.feed_one(last.data(), {1, {5 * kSecondNs + 3, 0}}, 5 * kSecondNs + 3);
    const LineItem item = line.line.next();
    REQUIRE(item.kind == LineItem::kTrouble);
    CHECK(item.trouble == LineTrouble::no_valid_frame);
    CHECK(item.unread_bytes == 7 + 5 + 9 + 1 + 1);
}

TEST_CASE("wire line: frames without a HELLO for five seconds") {
    Line line;
    for (std::int64_t k = 0; k < 10; ++k)
        CHECK(line.one(sample(static_cast<std::uint16_t>(k)), k * kSecondNs / 2) == Words{"1 samples"});
    CHECK(line.one(sample(10), 5 * kSecondNs) == Words{"1 samples", "no_hello 5000"});
}

TEST_CASE("wire line: a stall of the program proves nothing") {
    for (const std::int64_t stall : {2 * kSecondNs, 2 * kSecondNs + 1}) {
        Line line;
        line.line.resume(4 * kSecondNs);
        // Twelve ticks of the whole silence, and the trouble; or the moment of coming back alone.
        CHECK(line.silent(4 * kSecondNs + stall).size() == (stall > 2 * kSecondNs ? 1 : 13));
        line.line.resume(7 * kSecondNs);
        Reads reads;
        CHECK(line.feed(reads.add(sample(1), 9 * kSecondNs + 1)) == Words{"1 samples"});
    }
}

TEST_CASE("wire line: a port that is not open is neither silent nor read") {
    Line line;
    line.one(hello() + Bytes(3, 1), 1);
    CHECK(line.line.failed("unplugged", {2, 5}));
    CHECK(line.line.unix_offset_ns == 5);
    CHECK(line.troubles(20 * kSecondNs) == Words{});
    CHECK_FALSE(line.line.failed("unplugged", {3, 5}));
    CHECK(line.line.failed("no_port", {4, 5}));
    line.line.opened({30 * kSecondNs, 6});
    CHECK(line.line.unix_offset_ns == 6);
    CHECK(line.one(hello() + sample(0), 30 * kSecondNs) == Words{"same hello", "1 samples"});
}

TEST_CASE("wire line: on a port that was opened again all begins anew") {
    Line line;
    line.one(hello() + sample(0), 1);
    line.line.opened({100 * kSecondNs, 0});
    CHECK(line.troubles(105 * kSecondNs - 1) == Words{});
    // The old HELLO is not known to be this device's.
    Line waits;
    waits.one(hello(), 1);
    waits.line.opened({100 * kSecondNs, 0});
    for (std::int64_t k = 200; k < 210; ++k) waits.one(sample(0), k * kSecondNs / 2);
    CHECK(waits.one(sample(1), 105 * kSecondNs) == Words{"1 samples", "no_hello 105000"});
    // Nor is the old refusal.
    Line refused;
    refused.one(hello(13), 1);
    refused.line.opened({2, 0});
    CHECK(refused.one(sample(0), 3) == Words{"1 samples"});
    // Unread bytes of before do not count.
    Line unread;
    unread.one(Bytes(9, 1), 1);
    unread.line.opened({4 * kSecondNs, 0});
    CHECK(unread.one(Bytes(9, 1), 5 * kSecondNs + 1) == Words{});
    CHECK(unread.troubles(8 * kSecondNs) == Words{});
}

TEST_CASE("wire line: reads between which a trouble may be due are taken one by one") {
    const auto given = [](Line& line, std::int64_t first_ns) {
        Reads reads;
        return line.feed(reads.add(sample(1), first_ns).add(sample(2), first_ns + 1)).size();
    };
    Line closed;
    closed.one(hello(), 1);
    CHECK(given(closed, 2) == 1);
    closed.line.failed("unplugged", {3, 0});
    CHECK(given(closed, 4) == 2);
    Line refused;
    refused.one(hello(), 1);
    refused.one(hello(13), 2);
    Reads healed;
    CHECK(refused.feed(healed.add(hello() + sample(1), 3).add(sample(2), 4)) ==
          Words{"same hello", "1 samples", "1 samples"});
    for (const std::int64_t left : {0, 1}) {  // four seconds after the first unread byte, and just before
        Line unread;
        unread.one(hello(), 1);
        unread.one(Bytes{9}, kSecondNs);
        for (std::int64_t k = 3; k < 10; ++k) unread.one(Bytes{9}, k * kSecondNs / 2);
        const std::int64_t at = 5 * kSecondNs - left;
        Reads reads;
        reads.add(Bytes{0} + sample(1), at).add(sample(2), at);
        CHECK(unread.feed(reads).size() == (left == 1 ? 2 : 3));  // the bad block, and all samples or each
    }
}

TEST_CASE("wire line: the first byte after a silence is not five seconds of rubbish") {
    Line line;
    line.one(Bytes(9, 1), 1);
    CHECK(line.one(Bytes(4, 1), 5 * kSecondNs + 1) == Words{});
    for (std::int64_t k = 11; k < 21; ++k) CHECK(line.one(Bytes(1, 1), k * kSecondNs / 2) == Words{});
    const Bytes last(1, 1);
    line.line.feed_one(last.data(), {1, {10 * kSecondNs + 1, 0}}, 10 * kSecondNs + 1);
    CHECK(line.line.next().unread_bytes == 4 + 10 + 1);
}

TEST_CASE("wire line: a device that was refused did say HELLO") {
    Line line;
    line.one(hello(13), 1);
    for (std::int64_t k = 1; k < 12; ++k) CHECK(line.one(sample(0), k * kSecondNs / 2) == Words{});
}

TEST_CASE("wire line: columns of a later second, and of later samples of a run") {
    Line line;
    line.one(hello(), 1);
    Reads reads;
    reads.add(sample(1), kSecondNs / 3).add(sample(2), kSecondNs / 2).add(sample(3), kSecondNs);
    reads.add(sample(4) + sample(7), kSecondNs + 1).add(sample(8), kSecondNs + 2);
    line.line.feed(reads.bytes.data(), reads.reads.data(), reads.reads.size(), kSecondNs / 3);
    CHECK(line.line.next().samples.n == 2);
    LineItem item = line.line.next();
    REQUIRE(item.samples.n == 2);
    CHECK(item.samples.host_ns[0] == kSecondNs);
    CHECK(item.samples.host_ns[1] == kSecondNs + 1);
    CHECK(line.line.counts().frames == 3);
    item = line.line.next();
    CHECK(line.line.counts().frames == 3);  // a run counts as a whole
    REQUIRE(item.samples.n == 2);
    CHECK(item.samples.host_ns[1] == kSecondNs + 2);
    CHECK(item.samples.gyro[3] == 8.0);
    CHECK(item.samples.accel[2] == 9.0);
    CHECK(item.samples.temperature[1] == -3.0);
    CHECK(line.line.next().kind == LineItem::kDone);
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
    line.line.accept_hello();  // of nothing
    CHECK(line.one(hello(), 3) == Words{"frame 1"});
    line.line.silent(5 * kSecondNs + 3);
    for (int k = 0; k < 9; ++k) CHECK(line.line.next().kind == LineItem::kTick);
    line.line.pass_time(0);
    CHECK(line.line.next().kind == LineItem::kDone);  // nine of ten ticks
    line.line.silent(5 * kSecondNs + 3);
    CHECK(line.line.next().kind == LineItem::kTick);
    line.line.pass_time(0);
    CHECK(line.line.next().kind == LineItem::kDone);  // the tick before the trouble
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
        for (LineItem item = line.line.next(); item.kind != LineItem::kDone; item = line.line.next()) {
            if (item.kind == LineItem::kFrame && item.type == Hello::type()) line.line.accept_hello();
            if (item.kind != LineItem::kSamples) ++others;
            for (std::size_t i = 0; item.kind == LineItem::kSamples && i < item.samples.n; ++i)
                CHECK(item.samples.sequence[i] == next++);
        }
        CHECK(next == 60);
        CHECK(others == 7 + 7 + 9);
        CHECK(line.line.counts().frames == 60 + 14);
        CHECK(line.line.counts().bytes == size_of(stream));
    }
}
