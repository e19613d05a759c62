// The items into which port_decoder.hpp decodes what comes from a serial port, such as samples, other frames
// and troubles of the port. Also the counts of what came from the port.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder.hpp"
#include "port_watch.hpp"
#include "sample_columns.hpp"

namespace fltea {

// One item. Its pointers and columns stay valid until the next call of a non-const method of the object that
// has returned the item.
struct PortItem {
    enum Kind : std::uint8_t {
        kDone,            // the given bytes contain no more items
        kSamples,         // consecutive samples, with no other item between them
        kFrame,           // a valid frame of another type than SAMPLE
        kSameHello,       // a HELLO identical, byte for byte, to the HELLO that was accepted last
        kRefusedVersion,  // a HELLO of another protocol version: nothing after it may be interpreted
        kBad,             // a block of bytes that is not a valid frame
        kTick,            // no bytes came from the port for a while
        kTrouble,         // a trouble of the port: it is silent, unreadable or without a HELLO
    };
    Kind kind = kDone;
    // arrival time of the read in which the frame ended; samples have their own arrival times
    std::int64_t host_ns = 0;
    SampleColumns samples = {};    // raw counts; gyro and accel have the shape (n, 3)
    Reason reason = Reason::none;  // only for bad blocks: why the block is not a valid frame
    // type of the frame; the fields from `sequence` to `size` also belong to a frame
    std::uint8_t type = 0;
    std::uint16_t sequence = 0;
    std::uint32_t device_us = 0;
    const std::uint8_t* bytes = nullptr;  // payload of a frame, or a bad block as received
    std::size_t size = 0;
    PortTrouble trouble = PortTrouble::none;
    // only for the trouble no_valid_frame: bytes since the last readable frame
    std::int64_t unread_bytes = 0;
    bool is_news = false;  // only for kRefusedVersion: whether the refusal has to be reported
};

// Counts of what the caller received from a port, and of frames and bytes that could not be used.
struct PortCounts {
    std::int64_t bytes = 0, frames = 0, connections = 0;
    // frames that were not interpreted: HELLOs of another protocol version, and all frames after a HELLO that
    // was refused
    std::int64_t refused = 0;
    struct Bad {
        Reason reason;
        std::int64_t blocks;
    };
    // number of bad blocks for each reason, in the order in which the reasons first occurred
    std::vector<Bad> bad;

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
