// The host's receiver of the wire (protocol/README.md, "Framing"): bytes of one port in, frames out.
//
// It gives the same as a decoder in plain Python, tests/rig/plain_decoder.py, which is its oracle
// (tests/wire/test_block_reader.py), at a tenth of the cost or less. It parses whatever a line delivers:
// nothing is read beyond what was given, and between calls it keeps at most one unfinished block.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "messages.h"

namespace fltea {

// One good SAMPLE.
struct SampleRow {
    std::int64_t end;  // offset in the bytes fed, just behind its closing 0x00
    std::uint32_t device_us;
    std::uint16_t sequence;
    Sample sample;
};

// In the order in which they are judged; the first that holds counts. Names: reason_name().
enum class Reason : std::uint8_t { none, partial, oversize, cobs, short_, crc, unknown_type, length };

// As in fltea.wire.messages.REASONS; nullptr for none.
const char* reason_name(Reason reason);

// A frame of another type, or a block that is no good frame.
struct OtherRow {
    std::size_t row;   // samples of the same call that stand before it
    std::int64_t end;  // as in SampleRow; of an oversize block behind the byte that made it too long
    Reason reason;     // none: an intact frame, whose header follows
    std::uint8_t type;
    std::uint16_t sequence;
    std::uint32_t device_us;
    // Its part of Decoded::bytes: the payload of an intact frame; else the block as it came, without the
    // 0x00, of an oversize one the first kMaxBlock bytes.
    std::size_t offset;
    std::size_t size;
};

// What one call found, each kind in the order of the bytes.
struct Decoded {
    std::vector<SampleRow> samples;
    std::vector<OtherRow> others;
    std::vector<std::uint8_t> bytes;
};

// Whether the payload of an intact HELLO is one of another version, of which nothing may be interpreted.
bool is_other_version(const std::uint8_t* payload, std::size_t n);

class Decoder {
  public:
    // A frame after COBS, without the 0x00 [bytes].
    static constexpr std::size_t kMaxBlock = kMaxWire - 1;

    // Adds to `found` what ends in these bytes. An intact HELLO of another version is an intact frame of any
    // length, because its version is for the caller to judge.
    void feed(const std::uint8_t* data, std::size_t n, Decoded& found);

    // The port was opened again: drops the unfinished block, and the next one may be partial.
    void reset() { *this = Decoder(); }

    // Bytes of the unfinished block.
    std::size_t pending() const { return pending_; }

  private:
    void judge(const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;
    void bad(Reason reason, const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;

    std::uint8_t block_[kMaxBlock] = {};
    std::size_t pending_ = 0;
    bool discarding_ = false;  // the rest of an oversize block
    bool attaching_ = true;    // no 0x00 since the port was opened
};

}  // namespace fltea
