// Tests of the receiver that the other tests use (receiver.h), with the test vectors, so that its verdict on
// the firmware's bytes can be trusted.
#include <doctest/doctest.h>

#include "receiver.h"
#include "vectors.h"

namespace {

void check_frame(const Frame& frame, int type, int sequence, uint32_t device_us) {
    CHECK(int(frame.type) == type);
    CHECK(int(frame.sequence) == sequence);
    CHECK(frame.device_us == device_us);
}

}  // namespace

TEST_CASE("receiver: every good vector, with its payload") {
    for (const Record& record : records("good.txt")) {
        CAPTURE(value_of(record, "name"));
        const Bytes wire = from_hex(value_of(record, "wire"));
        Receiver receiver;
        receiver.feed(0);
        receiver.feed(wire.data(), wire.size());
        REQUIRE(receiver.intact.size() == 1);
        const Frame& frame = receiver.intact[0];
        check_frame(frame, std::stoi(value_of(record, "type")), std::stoi(value_of(record, "sequence")),
                    static_cast<uint32_t>(std::stoul(value_of(record, "device_us"))));
        CHECK(frame.payload == from_hex(value_of(record, "payload")));
    }
}

TEST_CASE("receiver: every bad vector has its reason and no frame") {
    for (const Record& record : records("bad.txt")) {
        CAPTURE(value_of(record, "name"));
        Receiver receiver;
        const Bytes wire = from_hex(value_of(record, "wire"));
        receiver.feed(wire.data(), wire.size());
        CHECK(receiver.frames.empty());
        CHECK(receiver.judged() == 1);
        for (const std::pair<std::string, std::string>& line : record) {
            if (line.first == "bad") CHECK(receiver.counts[line.second] == 1);
            if (line.first == "refused") CHECK(receiver.refused == 1);
        }
    }
}

TEST_CASE("receiver: every stream gives its frames and counts") {
    for (const Record& record : records("streams.txt")) {
        CAPTURE(value_of(record, "name"));
        Receiver receiver;
        std::map<std::string, int> expected;
        std::vector<std::string> frames;
        int refused = 0;
        for (const std::pair<std::string, std::string>& line : record) {
            if (line.first == "bytes") {
                const Bytes bytes = from_hex(line.second);
                receiver.feed(bytes.data(), bytes.size());
            } else if (line.first == "frame") {
                frames.push_back(line.second);
            } else if (line.first == "refused") {
                ++refused;
            } else if (line.first == "count") {
                const size_t blank = line.second.find(' ');
                expected[line.second.substr(0, blank)] = std::stoi(line.second.substr(blank + 1));
            }
        }
        CHECK(receiver.counts == expected);
        CHECK(receiver.refused == refused);
        REQUIRE(receiver.frames.size() == frames.size());
        for (size_t i = 0; i < frames.size(); ++i) {
            std::istringstream words(frames[i]);
            int type = 0;
            int sequence = 0;
            uint32_t device_us = 0;
            words >> type >> sequence >> device_us;
            check_frame(receiver.frames[i], type, sequence, device_us);
        }
    }
}
