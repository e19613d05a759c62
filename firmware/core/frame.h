// Encodes frames. One frame on the wire is COBS( type u8 | sequence u16 | device_us u32 | payload | CRC-32
// u32 ), then 0x00. Each byte passes through the CRC and the COBS encoder directly into the caller's buffer,
// so no second buffer is needed.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <type_traits>

#include "cobs.h"
#include "crc32.h"
#include "messages.h"

namespace fltea {

// Number of bytes of a message on the wire, including the closing 0x00.
template <typename Message>
constexpr size_t wire_size() {
    return cobs_max_encoded(kMaxFrame - kMaxPayload + Message::size()) + 1;
}

// Begins a frame. `out` must have room for kMaxWire bytes, or for wire_size() of the message. The payload may
// have at most kMaxPayload bytes.
class FrameWriter {
  public:
    FrameWriter(uint8_t type, uint16_t sequence, uint32_t device_us, uint8_t* out) : out_(out), cobs_(out) {
        u8(type);
        u16(sequence);
        u32(device_us);
    }

    void u8(uint8_t value) {
        crc_.add(value);
        cobs_.put(value);
    }
    void u16(uint16_t value) {
        u8(static_cast<uint8_t>(value & 0xFF));
        u8(static_cast<uint8_t>(value >> 8));
    }
    void u32(uint32_t value) {
        u16(static_cast<uint16_t>(value & 0xFFFF));
        u16(static_cast<uint16_t>(value >> 16));
    }

    // Ends the frame. Returns its number of bytes on the wire, including the 0x00. Add no bytes after this.
    size_t finish() {
        u32(crc_.value());
        const size_t n = cobs_.finish();
        out_[n] = 0;
        return n + 1;
    }

  private:
    uint8_t* out_;
    Crc32 crc_;
    CobsEncoder cobs_;
};

// Visits the fields of a message (messages.h), and writes each field into the payload of a frame.
class FieldWriter {
  public:
    explicit FieldWriter(FrameWriter& frame) : frame_(frame) {}

    void operator()(const char*, uint8_t value) { frame_.u8(value); }
    void operator()(const char*, uint16_t value) { frame_.u16(value); }
    void operator()(const char*, uint32_t value) { frame_.u32(value); }
    void operator()(const char*, int16_t value) { frame_.u16(static_cast<uint16_t>(value)); }
    void operator()(const char*, float value) {
        static_assert(sizeof(float) == sizeof(uint32_t), "IEEE single precision");
        uint32_t bits = 0;
        memcpy(&bits, &value, sizeof bits);
        frame_.u32(bits);
    }

    template <typename Enum>
    typename std::enable_if<std::is_enum<Enum>::value>::type operator()(const char*, Enum value) {
        frame_.u8(static_cast<uint8_t>(value));
    }

    // Writes a field of type bytesN or textN (N bytes). The code that set a textN has padded it with NUL.
    template <typename Byte, size_t N>
    void operator()(const char*, const Byte (&value)[N]) {
        for (size_t i = 0; i < N; ++i) frame_.u8(static_cast<uint8_t>(value[i]));
    }

  private:
    FrameWriter& frame_;
};

// Encodes a payload of n bytes as a frame. Returns the number of bytes on the wire, including the closing
// 0x00. If the payload is longer than kMaxPayload, returns 0 and writes nothing.
inline size_t encode_frame(uint8_t type, uint16_t sequence, uint32_t device_us, const uint8_t* payload,
                           size_t n, uint8_t* out) {
    if (n > kMaxPayload) return 0;
    FrameWriter frame(type, sequence, device_us, out);
    for (size_t i = 0; i < n; ++i) frame.u8(payload[i]);
    return frame.finish();
}

// Encodes a message, which is a struct of messages.h, as a frame. Returns the number of bytes on the wire.
template <typename Message>
size_t encode_message(const Message& message, uint16_t sequence, uint32_t device_us, uint8_t* out) {
    static_assert(Message::size() <= kMaxPayload, "the payload does not fit a frame");
    FrameWriter frame(Message::type(), sequence, device_us, out);
    FieldWriter write(frame);
    Message::visit_fields(message, write);
    return frame.finish();
}

}  // namespace fltea
