// What the tests of the port decoder share: a decoder, and the bytes that it gets, divided into reads.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "frame.h"
#include "port_decoder.hpp"

namespace port_decoder_rig {

using namespace fltea;

using Bytes = std::vector<std::uint8_t>;
using Words = std::vector<std::string>;

constexpr std::int64_t kMs = 1'000'000;
constexpr PortTimes kTimes = {5 * kSecondNs, kSecondNs / 2, 60 * kSecondNs};

inline Bytes frame(std::uint8_t type, const Bytes& payload, std::uint16_t sequence = 0) {
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_frame(type, sequence, 7, payload.data(), payload.size(), wire);
    return Bytes(wire, wire + n);
}

inline Bytes sample(std::uint16_t sequence) {
    Sample one = {};
    one.gyro_x = static_cast<std::int16_t>(sequence);
    one.accel_z = 9;
    one.temperature = -3;
    one.flags = 4;
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_message(one, sequence, sequence * 10u, wire);
    return Bytes(wire, wire + n);
}

inline Bytes hello(std::uint32_t boot = 5, std::uint8_t major = kProtocolMajor) {
    Hello one = {};
    one.protocol_major = major;
    one.protocol_minor = kProtocolMinor;
    one.schema_hash = kSchemaHash;
    one.boot_id = boot;
    std::uint8_t wire[kMaxWire];
    const std::size_t n = encode_message(one, 0, 0, wire);
    return Bytes(wire, wire + n);
}

inline Bytes fault() { return frame(Fault::type(), Bytes(Fault::size(), 1)); }

inline Bytes operator+(Bytes one, const Bytes& other) {
    one.insert(one.end(), other.begin(), other.end());
    return one;
}

// Returns a stamp with the time `host_ns`. The stamp's offset to Unix time is `host_ns` + 1, or the largest
// number if the sum would overflow.
inline Stamp stamp(std::int64_t host_ns) {
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

// A port decoder whose port was opened at the time 0. Each function returns a text: a word for each item that
// the decoder gave, followed by the item's time or count. HELLOs with the boot id 13 are refused.
struct Line {
    PortDecoder line{kTimes};

    Line() { line.opened({0, 1}); }

    Words all() {
        Words found;
        for (PortItem item = line.next(); item.kind != PortItem::kDone; item = line.next()) {
            found.push_back(word(item));
            if (item.kind == PortItem::kFrame && item.type == Hello::type()) judge(item, found);
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
    // Returns the troubles (a silent port, unreadable bytes, no HELLO) that the decoder reports if no byte
    // comes until `now_ns`.
    Words troubles(std::int64_t now_ns) {
        Words found;
        for (const std::string& one : silent(now_ns)) {
            if (one.compare(0, 4, "tick") != 0) found.push_back(one);
        }
        return found;
    }

  private:
    void judge(const PortItem& item, Words& found) {
        if (item.bytes[6] != 13) {
            line.accept_hello();
        } else if (line.refuse_hello()) {
            found.push_back("bad_hello");
        }
    }

    static std::string word(const PortItem& item) {
        switch (item.kind) {
            case PortItem::kDone:
                return "done";
            case PortItem::kSamples:
                return std::to_string(item.samples.n) + " samples";
            case PortItem::kFrame:
                return "frame " + std::to_string(item.type);
            case PortItem::kSameHello:
                return "same hello";
            case PortItem::kRefusedVersion:
                return item.is_news ? "version" : "version again";
            case PortItem::kBad:
                return reason_name(item.reason);
            case PortItem::kTick:
                return "tick " + std::to_string(item.host_ns / kMs);
            case PortItem::kTrouble:
                return trouble_name(item.trouble) + (" " + std::to_string(item.host_ns / kMs));
        }
        return "";
    }
};

inline std::int64_t size_of(const Bytes& bytes) { return static_cast<std::int64_t>(bytes.size()); }

}  // namespace port_decoder_rig
