// CRC-32 of zlib, PNG and Ethernet (reflected, polynomial 0x04C11DB7, all ones in and out).
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace fltea {

class Crc32 {
  public:
    void add(uint8_t byte) {
        // Processes half a byte per step, with a table of 64 bytes in place of the usual 1,024 bytes. This is
        // fast enough for the 28 bytes of a SAMPLE at 100 Hz.
        static const uint32_t table[16] = {
            0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
            0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
        };
        state_ ^= byte;
        state_ = (state_ >> 4) ^ table[state_ & 15];
        state_ = (state_ >> 4) ^ table[state_ & 15];
    }

    // Returns the CRC of the bytes that were passed to put() so far. More bytes may follow.
    uint32_t value() const { return ~state_; }

  private:
    uint32_t state_ = 0xFFFFFFFF;
};

inline uint32_t crc32(const uint8_t* data, size_t n) {
    Crc32 crc;
    for (size_t i = 0; i < n; ++i) crc.add(data[i]);
    return crc.value();
}

}  // namespace fltea
