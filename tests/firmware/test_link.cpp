// Tests of sending frames (firmware/core/link.h), with and without room for them in the ring buffer.
#include <doctest/doctest.h>

#include "faults.h"
#include "link.h"
#include "rig.h"

using fltea::FaultCode;

namespace {

struct Line {
    FakeClock clock;
    FakeSink sink{clock};
    fltea::Link link{sink};
};

// Returns a HELLO that the tests' receiver of frames accepts.
fltea::Hello hello() {
    fltea::Hello message = {};
    message.protocol_major = fltea::kProtocolMajor;
    message.schema_hash = fltea::kSchemaHash;
    return message;
}

}  // namespace

TEST_CASE("link: 0x00 before the first frame and no other") {
    Line line;
    line.link.send_sample(fltea::Sample{}, 7, 1);
    CHECK(line.sink.bytes.size() == 29);
    CHECK(line.sink.bytes[0] == 0);
    line.link.send_sample(fltea::Sample{}, 8, 2);
    CHECK(line.sink.bytes.size() == 57);
    CHECK(line.sink.bytes[29] != 0);
    CHECK(line.sink.receiver.frames[1].sequence == 8);
    CHECK(line.link.dropped_frames() == 0);
}

TEST_CASE("link: a sample goes if it just fits, else it is dropped whole and counted") {
    Line line;
    line.sink.jammed = true;
    line.sink.size = 28;
    line.link.send_sample(fltea::Sample{}, 0, 0);
    CHECK(line.sink.bytes.empty());
    CHECK(line.link.dropped_frames() == 1);
    line.sink.size = 29;
    line.link.send_sample(fltea::Sample{}, 1, 0);
    CHECK(line.sink.bytes.size() == 29);
    line.sink.size = 29 + 27;
    line.link.send_sample(fltea::Sample{}, 2, 0);
    CHECK(line.sink.bytes.size() == 29);
    CHECK(line.link.dropped_frames() == 2);
    line.sink.size = 29 + 28;
    line.link.send_sample(fltea::Sample{}, 3, 0);
    CHECK(line.sink.bytes.size() == 57);
    CHECK(line.link.dropped_frames() == 2);
}

TEST_CASE("link: any other message goes if a sample still fits beside it, else later under the same number") {
    Line line;
    line.sink.jammed = true;
    line.sink.size = 1 + fltea::wire_size<fltea::Hello>() + 27;
    CHECK_FALSE(line.link.send(hello(), 0));
    CHECK(line.sink.bytes.empty());
    line.sink.size += 1;
    CHECK(line.link.send(hello(), 0));
    CHECK(line.link.dropped_frames() == 0);
    CHECK(line.sink.receiver.frames[0].sequence == 0);
    CHECK_FALSE(line.link.send(fltea::Status{}, 0));
    line.sink.size = 10000;
    CHECK(line.link.send(fltea::Status{}, 0));
    CHECK(line.link.send(fltea::Status{}, 0));
    CHECK(line.link.send(hello(), 0));
    const std::vector<Frame>& frames = line.sink.receiver.frames;
    CHECK(frames[1].sequence == 0);
    CHECK(frames[2].sequence == 1);
    CHECK(frames[3].sequence == 1);
}

TEST_CASE("link: HELLO and a sample fit Arduino's ring of 128, of which one stays free") {
    CHECK(1 + fltea::wire_size<fltea::Hello>() + fltea::wire_size<fltea::Sample>() <= 127);
    CHECK(fltea::wire_size<fltea::Sample>() == 28);
}

TEST_CASE("faults: each code at most once a second; what comes sooner is told when the second is over") {
    Line line;
    fltea::Faults faults;
    for (uint32_t us = 0; us < 5500000; us += 10000) {
        faults.raise(FaultCode::bus_held, us);
        if (us == 700000) faults.raise(FaultCode::sensor_lost, 3);
        line.clock.pass(10000);
        faults.send(line.link, line.clock.now_us());
    }
    std::vector<Frame> held;
    int lost = 0;
    for (const Frame& frame : line.sink.receiver.frames) {
        const fltea::Fault fault = message_of<fltea::Fault>(frame);
        if (fault.code == FaultCode::bus_held) held.push_back(frame);
        lost += fault.code == FaultCode::sensor_lost;
    }
    CHECK(lost == 1);
    REQUIRE(held.size() == 6);
    for (size_t i = 1; i < 6; ++i) CHECK(held[i].device_us - held[i - 1].device_us == 1000000);
    CHECK(message_of<fltea::Fault>(held[5]).detail == 5000000);
}

TEST_CASE("faults: each code has its own place") {
    Line line;
    line.sink.size = 1000;
    fltea::Faults faults;
    for (uint8_t code = 1; code <= 6; ++code) faults.raise(static_cast<FaultCode>(code), code * 10u);
    faults.send(line.link, 0);
    REQUIRE(line.sink.receiver.frames.size() == 6);
    for (uint8_t i = 0; i < 6; ++i) {
        const fltea::Fault fault = message_of<fltea::Fault>(line.sink.receiver.frames[i]);
        CHECK(fault.code == static_cast<FaultCode>(i + 1));
        CHECK(fault.detail == (i + 1) * 10u);
    }
}

TEST_CASE("faults: none is lost while the line is full") {
    Line line;
    line.sink.size = 10;
    fltea::Faults faults;
    faults.raise(FaultCode::sensor_lost, 3);
    faults.send(line.link, 0);
    CHECK(line.sink.bytes.empty());
    line.sink.size = 127;
    faults.send(line.link, 20);
    CHECK(line.sink.receiver.frames.size() == 1);
    faults.send(line.link, 2000000);
    CHECK(line.sink.receiver.frames.size() == 1);
}

TEST_CASE("link: a line that takes nothing for 10 s: samples are dropped and counted, then all goes on") {
    Rig rig;
    rig.start_and_settle();
    rig.sink.jammed = true;
    rig.run(10 * kS);
    rig.sink.jammed = false;
    rig.run(2 * kS);
    const std::vector<Frame> samples = rig.samples();
    CHECK(samples.back().sequence + 1u == samples.size() + rig.status().dropped_frames);
    CHECK(rig.status().dropped_frames > 980);
    CHECK(rig.status().overruns == 0);
    CHECK(rig.sink.receiver.judged() == rig.sink.receiver.counts["frames"]);
}

TEST_CASE("link: each message has its own numbers, up to 65535 and on from 0") {
    Line line;
    line.sink.size = 1 << 20;
    for (uint32_t i = 0; i < 65536 + 10; ++i) {
        const uint16_t number = static_cast<uint16_t>(i);
        REQUIRE(line.link.send(fltea::Fault{}, i));
        if (i % 100 == 0) line.link.send_sample(fltea::Sample{}, number, i);
        line.clock.pass(10 * kMs);
        REQUIRE(line.sink.receiver.frames.front().sequence == number);
        line.sink.receiver.frames.clear();
    }
    REQUIRE(line.link.send(fltea::Status{}, 0));
    CHECK(line.sink.receiver.frames.back().sequence == 0);
}
