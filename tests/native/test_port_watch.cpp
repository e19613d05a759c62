// Tests when a serial port counts as silent, unreadable or without a HELLO, and when that is reported.
#include <doctest/doctest.h>

#include <cstdint>

#include "port_decoder_rig.hpp"

using namespace port_decoder_rig;

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
    // A sample can be read now, so no_valid_frame is over. But there was no HELLO since the port was opened,
    // 6 s ago.
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
    const PortItem item = line.line.next();
    REQUIRE(item.kind == PortItem::kTrouble);
    CHECK(item.trouble == PortTrouble::no_valid_frame);
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
        // If the port is silent for 6 s, there are 13 items: a tick for each half second without bytes, and
        // the report that the port is silent. If the program itself stood still for more than 2 s, the
        // silence proves nothing: there is only one tick, at the time at which the program continues.
        CHECK(line.silent(4 * kSecondNs + stall).size() == (stall > 2 * kSecondNs ? 1 : 13));
        line.line.resume(7 * kSecondNs);
        Reads reads;
        CHECK(line.feed(reads.add(sample(1), 9 * kSecondNs + 1)) == Words{"1 samples"});
    }
}

TEST_CASE("wire line: bytes that were read just before a stall of the program prove nothing either") {
    for (const bool comes_again : {true, false}) {
        Line line;
        line.one(hello(), kSecondNs);
        line.line.resume(2 * kSecondNs);
        Reads reads;  // the first bytes waited during the stall; the next ones came after it
        reads.add(sample(1), 2 * kSecondNs + 1);
        if (comes_again) reads.add(sample(2), 9 * kSecondNs);
        line.line.feed(reads.bytes.data(), reads.reads.data(), reads.reads.size(), 9 * kSecondNs + 1);
        for (const std::string& one : line.all()) CHECK(one != "silent 7000");
        line.line.resume(9 * kSecondNs + 1);
        Words found;
        for (std::int64_t now_s = 10; now_s <= 15; ++now_s) {
            CHECK((now_s == 15 || found.empty()));
            for (const std::string& one : line.troubles(now_s * kSecondNs)) found.push_back(one);
            line.line.resume(now_s * kSecondNs);
        }
        REQUIRE(found.size() == 1);
        CHECK(found[0].compare(0, 9, "silent 14") == 0);
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
    // After the port was opened again, a HELLO is missing: the earlier HELLO may have come from another
    // device.
    Line waits;
    waits.one(hello(), 1);
    waits.line.opened({100 * kSecondNs, 0});
    for (std::int64_t k = 200; k < 210; ++k) waits.one(sample(0), k * kSecondNs / 2);
    CHECK(waits.one(sample(1), 105 * kSecondNs) == Words{"1 samples", "no_hello 105000"});
    // A HELLO that was refused before the port was opened again does not matter any more.
    Line refused;
    refused.one(hello(13), 1);
    refused.line.opened({2, 0});
    CHECK(refused.one(sample(0), 3) == Words{"1 samples"});
    // If no frame can be read for 5 s, this is reported. Bytes that came before the port was opened again do
    // not count for this.
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
    // The frames come exactly four seconds after the first byte that belongs to no frame, or `left` = 1 ns
    // earlier.
    for (const std::int64_t left : {0, 1}) {
        Line unread;
        unread.one(hello(), 1);
        unread.one(Bytes{9}, kSecondNs);
        for (std::int64_t k = 3; k < 10; ++k) unread.one(Bytes{9}, k * kSecondNs / 2);
        const std::int64_t at = 5 * kSecondNs - left;
        Reads reads;
        reads.add(Bytes{0} + sample(1), at).add(sample(2), at);
        // first comes an item for the bad block; the two samples follow in one item or, if something may have
        // to be reported between them, in two
        CHECK(unread.feed(reads).size() == (left == 1 ? 2 : 3));
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
