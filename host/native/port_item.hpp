// Items that a port delivers (port_decoder.hpp), and their counts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder.hpp"
#include "port_watch.hpp"
#include "sample_columns.hpp"

namespace fltea {

// Pointers and columns stay valid until the next call of a non-const method.
struct PortItem {
    enum Kind : std::uint8_t {
        kDone,            // nothing more came in the given bytes
        kSamples,         // consecutive samples, with no other item between them
        kFrame,           // any other valid frame
        kSameHello,       // a HELLO identical, byte for byte, to the HELLO that was accepted last
        kRefusedVersion,  // a HELLO of another protocol version: nothing after it may be interpreted
        kBad,             // a block that is not a valid frame
        kTick,            // nothing came for a while
        kTrouble,         // a port trouble
    };
    Kind kind = kDone;
    std::int64_t host_ns = 0;      // arrival of the read in which a frame ended; each sample has its own
    SampleColumns samples = {};    // raw counts; gyro and accel are (n, 3)
    Reason reason = Reason::none;  // of a bad block
    std::uint8_t type = 0;         // of a frame, like the fields down to `size`
    std::uint16_t sequence = 0;
    std::uint32_t device_us = 0;
    const std::uint8_t* bytes = nullptr;  // payload of a frame, or a bad block as received
    std::size_t size = 0;
    PortTrouble trouble = PortTrouble::none;
    std::int64_t unread_bytes = 0;  // of the trouble no_valid_frame
    bool is_news = false;           // of kRefusedVersion: it has to be reported
};

// Counts of what the caller received, and of what was lost on the way.
struct PortCounts {
    std::int64_t bytes = 0, frames = 0, connections = 0;
    std::int64_t refused = 0;  // frames of a device of another version, or after a refused HELLO
    struct Bad {
        Reason reason;
        std::int64_t blocks;
    };
    std::vector<Bad> bad;  // in the order in which the reasons first occurred

    void add_bad(Reason reason) {
        for (Bad& one : bad) {
            if (one.reason == reason) {
                ++one.blocks;
                return;
            }
        }
        bad.push_back({reason, 1});
    }
};

}  // namespace fltea
