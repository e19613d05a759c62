// Computes the same CRC-32 as firmware/core/crc32.h, but takes eight bytes per step. A host can spare 8 kB of
// memory for the tables, and checking CRCs is most of the cost of decoding frames.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace fltea {

namespace crc32_table {

typedef std::array<std::array<std::uint32_t, 256>, 8> Tables;

// tables[k][b] is the contribution of a byte b to the CRC if k more bytes follow it (Kounavis and Berry, ISCC
// 2005).
constexpr Tables make() {
    Tables tables = {};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t crc = byte;
        for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) ? 0xEDB88320u : 0u);
        tables[0][byte] = crc;
    }
    for (std::size_t byte = 0; byte < 256; ++byte) {
        for (std::size_t k = 1; k < 8; ++k) {
            const std::uint32_t before = tables[k - 1][byte];
            tables[k][byte] = (before >> 8) ^ tables[0][before & 0xFF];
        }
    }
    return tables;
}

inline constexpr Tables kTables = make();

}  // namespace crc32_table

// Reads a little-endian number of four bytes. On a little-endian machine, compilers turn this into one load.
inline std::uint32_t load_u32(const std::uint8_t* bytes) {
    return static_cast<std::uint32_t>(bytes[0]) | static_cast<std::uint32_t>(bytes[1]) << 8 |
           static_cast<std::uint32_t>(bytes[2]) << 16 | static_cast<std::uint32_t>(bytes[3]) << 24;
}

inline std::uint32_t fast_crc32(const std::uint8_t* data, std::size_t n) {
    const crc32_table::Tables& t = crc32_table::kTables;
    std::uint32_t crc = 0xFFFFFFFFu;
    for (; n >= 8; data += 8, n -= 8) {
        const std::uint32_t low = crc ^ load_u32(data);
        const std::uint32_t high = load_u32(data + 4);
        crc = t[7][low & 0xFF] ^ t[6][low >> 8 & 0xFF] ^ t[5][low >> 16 & 0xFF] ^ t[4][low >> 24] ^
              t[3][high & 0xFF] ^ t[2][high >> 8 & 0xFF] ^ t[1][high >> 16 & 0xFF] ^ t[0][high >> 24];
    }
    if (n >= 4) {
        crc ^= load_u32(data);
        crc = t[3][crc & 0xFF] ^ t[2][crc >> 8 & 0xFF] ^ t[1][crc >> 16 & 0xFF] ^ t[0][crc >> 24];
        data += 4;
        n -= 4;
    }
    for (; n > 0; ++data, --n) crc = (crc >> 8) ^ t[0][(crc ^ *data) & 0xFF];
    return ~crc;
}

}  // namespace fltea
