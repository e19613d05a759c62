// Finds the records in a decompressed MCAP chunk (the MCAP specification, "Records" and "Message").
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace fltea {

// A record of a chunk. `begin` and `end` are the byte range of its content in the chunk; for a message, the
// content does not include the message's header. Only messages have `channel`, `sequence` and times; these
// are 0 for other records.
struct ChunkRecord {
    std::int64_t kind, begin, end, channel, sequence, log_time, publish_time;
};

// Says why a chunk cannot be read. `what`: the reason; if it is empty, the chunk can be read. `at`: offset of
// the faulty record in the chunk. `claimed`: length that the record's header states. `left`: number of bytes
// that the chunk has after that header.
struct ChunkFault {
    const char* what = "";
    std::uint64_t at = 0, claimed = 0, left = 0;
};

// Appends the records of a chunk, up to the first record that is invalid or runs beyond the chunk's end.
inline ChunkFault index_chunk(const std::uint8_t* data, std::size_t size, std::vector<ChunkRecord>& records) {
    constexpr std::size_t kHead = 9, kMessageHead = 22;
    constexpr std::uint8_t kMessage = 0x05;
    const auto number = [](const std::uint8_t* at, int bytes) {
        std::uint64_t value = 0;
        for (int i = bytes; i-- > 0;) value = value << 8 | at[i];
        return value;
    };
    const auto is_time = [](std::uint64_t value) { return value <= INT64_MAX; };
    std::size_t at = 0;
    while (at < size) {
        if (size - at < kHead) return {"half a head of a record", at, 0, size - at};
        const std::uint8_t kind = data[at];
        const std::uint64_t length = number(data + at + 1, 8);
        at += kHead;
        if (length > size - at) return {"a record longer than its chunk", at - kHead, length, size - at};
        ChunkRecord record = {
            kind, static_cast<std::int64_t>(at), static_cast<std::int64_t>(at + length), 0, 0, 0, 0};
        if (kind == kMessage) {
            const std::uint8_t* head = data + at;
            if (length < kMessageHead) return {"a message without times", at - kHead, length, size - at};
            if (!is_time(number(head + 6, 8)) || !is_time(number(head + 14, 8))) {
                return {"a message after the year 2262", at - kHead, length, size - at};
            }
            record.begin += static_cast<std::int64_t>(kMessageHead);
            record.channel = static_cast<std::int64_t>(number(head, 2));
            record.sequence = static_cast<std::int64_t>(number(head + 2, 4));
            record.log_time = static_cast<std::int64_t>(number(head + 6, 8));
            record.publish_time = static_cast<std::int64_t>(number(head + 14, 8));
        }
        records.push_back(record);
        at += static_cast<std::size_t>(length);
    }
    return {};
}

}  // namespace fltea
