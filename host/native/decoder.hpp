// The host's decoder of the wire protocol (protocol/README.md, "Framing"): takes the bytes of one port and
// returns frames.
//
// The decoder returns the same frames as the plain Python decoder tests/rig/plain_decoder.py, which
// tests/wire/test_block_reader.py compares with it, at a tenth of the cost or less. Any bytes may be fed: the
// decoder never reads beyond them, and keeps at most one unfinished block between calls.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "messages.h"

namespace fltea {

// One valid SAMPLE frame.
struct SampleRow {
    std::int64_t end;  // offset in the fed bytes, just after the closing 0x00
    std::uint32_t device_us;
    std::uint16_t sequence;
    Sample sample;
};

// Why a block is not a valid frame, in the order of the checks; the first that applies is reported. Names:
// reason_name().
enum class Reason : std::uint8_t { none, partial, oversize, cobs, short_, crc, unknown_type, length };

// Name as in fltea.wire.messages.REASONS; nullptr for none.
const char* reason_name(Reason reason);

// A frame of another type, or a block that is not a valid frame.
struct OtherRow {
    std::size_t row;   // number of samples of the same call that precede it
    std::int64_t end;  // as in SampleRow; for an oversize block, just after the byte that made it too long
    Reason reason;     // none: a valid frame, whose header fields follow
    std::uint8_t type;
    std::uint16_t sequence;
    std::uint32_t device_us;
    // Its byte range in Decoded::bytes. For a valid frame, this is the payload; otherwise the block as
    // received, without the 0x00 (of an oversize block, the first kMaxBlock bytes).
    std::size_t offset;
    std::size_t size;
};

// Results of one call. Each list is in the order of the bytes.
struct Decoded {
    std::vector<SampleRow> samples;
    std::vector<OtherRow> others;
    std::vector<std::uint8_t> bytes;
};

// Whether the payload of a valid HELLO states another protocol version. Then nothing else in it may be
// interpreted.
bool is_other_version(const std::uint8_t* payload, std::size_t n);

class Decoder {
  public:
    // Largest frame after COBS encoding, without the 0x00 [bytes].
    static constexpr std::size_t kMaxBlock = kMaxWire - 1;

    // Appends to `found` the frames and bad blocks that end in these bytes. A HELLO of another version is
    // valid at any length, because the caller judges its version.
    void feed(const std::uint8_t* data, std::size_t n, Decoded& found);

    // Call this when the port was reopened: drops the unfinished block. The next block may be partial.
    void reset() { *this = Decoder(); }

    // Number of bytes in the unfinished block.
    std::size_t pending() const { return pending_; }

  private:
    void judge(const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;
    void bad(Reason reason, const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;

    std::uint8_t block_[kMaxBlock] = {};
    std::size_t pending_ = 0;
    bool discarding_ = false;  // skips the rest of an oversize block
    bool attaching_ = true;    // no 0x00 has come since the port was opened
};

}  // namespace fltea
