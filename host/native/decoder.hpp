// The host's decoder of the wire protocol (protocol/README.md, "Framing"): takes the bytes of one serial port
// and returns frames.
//
// It returns the same frames as the plain Python decoder tests/rig/plain_decoder.py, at a tenth of the cost
// or less. tests/wire/test_block_reader.py compares the two decoders. Any bytes may be passed to this
// decoder. It never reads beyond them. Between calls it keeps at most one unfinished block, which is the
// bytes after the last 0x00.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "messages.h"

namespace fltea {

// One valid SAMPLE frame.
struct SampleRow {
    std::int64_t end;  // number of bytes of the same call of feed() up to and including the closing 0x00
    std::uint32_t device_us;
    std::uint16_t sequence;
    Sample sample;
};

// Why a block of bytes is not a valid frame. The checks are made in this order, and the first check that
// fails is reported. reason_name() gives the names of the reasons.
enum class Reason : std::uint8_t { none, partial, oversize, cobs, short_, crc, unknown_type, length };

// The name of a reason in fltea.wire.messages.REASONS, or nullptr for Reason::none.
const char* reason_name(Reason reason);

// A frame of another type than SAMPLE, or a block that is not a valid frame.
struct OtherRow {
    std::size_t row;  // number of elements of Decoded::samples that came before this item
    // number of bytes of the same call of feed() up to and including the closing 0x00; for an oversize block,
    // up to and including the byte that made the block too long
    std::int64_t end;
    // Reason::none means a valid frame; only for a valid frame are the following header fields set
    Reason reason;
    std::uint8_t type;
    std::uint16_t sequence;
    std::uint32_t device_us;
    // Byte range in Decoded::bytes. For a valid frame, it contains the payload. Otherwise it contains the
    // block as received without the 0x00, or the first kMaxBlock bytes of an oversize block.
    std::size_t offset;
    std::size_t size;
};

// What one call of the decoder has found. Each list is in the order in which the bytes came.
struct Decoded {
    std::vector<SampleRow> samples;
    std::vector<OtherRow> others;
    std::vector<std::uint8_t> bytes;
};

// Whether the payload of a valid HELLO states another protocol version. If so, nothing else in it may be
// interpreted.
bool is_other_version(const std::uint8_t* payload, std::size_t n);

class Decoder {
  public:
    // Size of the largest frame after COBS encoding, without the 0x00 [bytes].
    static constexpr std::size_t kMaxBlock = kMaxWire - 1;

    // Appends to `found` all frames and invalid blocks that end in these bytes. A HELLO of another protocol
    // version counts as valid whatever its length, because the caller judges its version.
    void feed(const std::uint8_t* data, std::size_t n, Decoded& found);

    // Drops the unfinished block. Call this when the serial port was reopened. The beginning of the first
    // block after that may be missing.
    void reset() { *this = Decoder(); }

    // Number of bytes in the unfinished block.
    std::size_t pending() const { return pending_; }

  private:
    void judge(const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;
    void bad(Reason reason, const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const;

    std::uint8_t block_[kMaxBlock] = {};
    std::size_t pending_ = 0;
    bool discarding_ = false;  // whether the rest of an oversize block is being skipped
    // whether no 0x00 has come since the port was opened, so that the first block may be incomplete
    bool attaching_ = true;
};

}  // namespace fltea
