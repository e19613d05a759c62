// What a wire gives (wire_line.hpp), item by item, and what is counted of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder.hpp"
#include "line_watch.hpp"
#include "sample_columns.hpp"

namespace fltea {

// Pointers and columns last until the next call of anything that is not const.
struct LineItem {
    enum Kind : std::uint8_t {
        kDone,            // nothing more came of what was given
        kSamples,         // samples that follow each other, without anything between them
        kFrame,           // any other intact frame
        kSameHello,       // a HELLO that is, byte for byte, the one that was accepted last
        kRefusedVersion,  // a HELLO of another version: nothing that follows may be interpreted
        kBad,             // a block that is no good frame
        kTick,            // nothing came for a while
        kTrouble,         // of the line
    };
    Kind kind = kDone;
    std::int64_t host_ns = 0;      // when the read came in which a frame ended; of samples each has its own
    SampleColumns samples = {};    // counts, gyro and accel (n, 3)
    Reason reason = Reason::none;  // of a bad block
    std::uint8_t type = 0;         // of a frame, as all until `size`
    std::uint16_t sequence = 0;
    std::uint32_t device_us = 0;
    const std::uint8_t* bytes = nullptr;  // payload of a frame, or bad block as it came
    std::size_t size = 0;
    LineTrouble trouble = LineTrouble::none;
    std::int64_t unread_bytes = 0;  // of trouble no_valid_frame
    bool is_news = false;           // of kRefusedVersion: it is to be told
};

// What was handed on, and what was lost on the way.
struct LineCounts {
    std::int64_t bytes = 0, frames = 0, connections = 0;
    std::int64_t refused = 0;  // frames of a device of another version, or whose HELLO was refused
    struct Bad {
        Reason reason;
        std::int64_t blocks;
    };
    std::vector<Bad> bad;  // in the order in which they first came

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
