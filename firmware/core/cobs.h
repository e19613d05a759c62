// Consistent Overhead Byte Stuffing (Cheshire and Baker, IEEE/ACM Transactions on Networking 7(2), 1999):
// encodes any bytes in such a way that no byte is 0x00, so that 0x00 can end a frame.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

// Largest number of bytes after encoding n bytes.
constexpr size_t cobs_max_encoded(size_t n) { return n == 0 ? 1 : n + (n + 253) / 254; }

// Encodes the bytes that are passed to put() one by one, and writes the result to `out`. For n bytes, `out`
// must have room for cobs_max_encoded(n) bytes.
class CobsEncoder {
  public:
    explicit CobsEncoder(uint8_t* out) : out_(out) {}

    void put(uint8_t byte) {
        // A full block of the encoding is closed only when another byte follows, so that the encoding never
        // ends with an empty block.
        if (code_ == kFull) open_block();
        if (byte == 0) {
            open_block();
        } else {
            out_[end_++] = byte;
            ++code_;
        }
    }

    // Ends the encoding. Returns the number of bytes written, without a closing 0x00. Do not call put()
    // afterwards.
    size_t finish() {
        out_[block_] = code_;
        return end_;
    }

  private:
    static constexpr uint8_t kFull = 0xFF;

    void open_block() {
        out_[block_] = code_;
        block_ = end_++;
        code_ = 1;
    }

    uint8_t* out_;
    // index in `out` of the code byte of the block in progress; the code byte is written when the block ends
    size_t block_ = 0;
    size_t end_ = 1;
    // value of the code byte: distance from the code byte to the 0x00 that the encoding leaves out
    uint8_t code_ = 1;
};

inline size_t cobs_encode(const uint8_t* data, size_t n, uint8_t* out) {
    CobsEncoder encoder(out);
    for (size_t i = 0; i < n; ++i) encoder.put(data[i]);
    return encoder.finish();
}

}  // namespace fltea
