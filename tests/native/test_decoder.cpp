// Tests of the host's decoder under sanitizers. The decoder gets test vectors that are divided into chunks of
// any size. It also gets hostile bytes, for which its results have to be those of tests/firmware/receiver.h.
// Its CRC is compared with the device's. tests/protocol compares the decoder with the host's Python code.
#include <doctest/doctest.h>

#include <random>

#include "../firmware/vectors.h"
#include "crc32.h"
#include "crc32_table.hpp"
#include "decoder_check.h"
#include "frame.h"

namespace {

Bytes stream_of(const Record& record) {
    Bytes stream;
    for (const std::pair<std::string, std::string>& line : record) {
        if (line.first != "wire" && line.first != "bytes") continue;
        const Bytes bytes = from_hex(line.second);
        stream.insert(stream.end(), bytes.begin(), bytes.end());
    }
    return stream;
}

// Returns a random stream of frames of every kind: whole, cut and damaged, with idle time and with very long
// blocks.
Bytes random_stream(std::mt19937& random) {
    Bytes stream;
    const auto below = [&random](unsigned n) { return static_cast<unsigned>(random()) % n; };
    for (unsigned part = below(12); part > 0; --part) {
        uint8_t wire[fltea::kMaxWire];
        Bytes payload(below(3) ? fltea::Sample::size() : below(fltea::kMaxPayload + 1));
        for (uint8_t& byte : payload) byte = static_cast<uint8_t>(below(2) ? below(256) : 0);
        size_t n = fltea::encode_frame(static_cast<uint8_t>(below(3) ? 2 : below(9)), 1, 2, payload.data(),
                                       payload.size(), wire);
        if (below(4) == 0) wire[below(static_cast<unsigned>(n))] = static_cast<uint8_t>(below(256));
        if (below(8) == 0) n = below(static_cast<unsigned>(n));
        stream.insert(stream.end(), wire, wire + n);
        if (below(8) == 0) stream.insert(stream.end(), below(600), static_cast<uint8_t>(below(4)));
    }
    return stream;
}

}  // namespace

TEST_CASE("decoder: every vector, in chunks of every size up to 40") {
    for (const char* name : {"good.txt", "bad.txt", "streams.txt"}) {
        for (const Record& record : records(name)) {
            CAPTURE(value_of(record, "name"));
            const Bytes stream = stream_of(record);
            for (size_t step = 1; step <= 40; ++step) {
                const std::string fault = compare_with_receiver(stream, [step] { return step; });
                CHECK_MESSAGE(fault.empty(), fault);
            }
        }
    }
}

TEST_CASE("decoder: any stream in any chunks, as the tests' own receiver reads it") {
    std::mt19937 random(1);
    for (int i = 0; i < 3000; ++i) {
        const Bytes stream = random_stream(random);
        const std::string fault =
            compare_with_receiver(stream, [&random] { return static_cast<size_t>(random() % 90); });
        REQUIRE_MESSAGE(fault.empty(), fault);
    }
}

TEST_CASE("crc32: eight bytes a step gives what the device's half a byte a step gives") {
    std::mt19937 random(2);
    for (size_t n = 0; n <= fltea::kMaxFrame; ++n) {
        Bytes bytes(n);
        for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
        CHECK(fltea::fast_crc32(bytes.data(), n) == fltea::crc32(bytes.data(), n));
    }
    for (const auto& row : table("crc32.txt")) {
        const Bytes bytes = from_runs(row.second);
        CHECK(fltea::fast_crc32(bytes.data(), bytes.size()) == std::stoul(row.first, nullptr, 16));
    }
}
