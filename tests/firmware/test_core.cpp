// Tests of the device's encoder, with test vectors and at its limits. The vectors are published values typed
// by hand, and results of the packages cobs and zlib (tools/make_vectors.py).
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <map>
#include <type_traits>

#include "cobs.h"
#include "crc32.h"
#include "frame.h"
#include "messages.h"
#include "receiver.h"
#include "vectors.h"

namespace {

// Encodes a frame into a heap block of exactly the size that wire_size() promises, so that the sanitizer
// detects a write beyond it.
Bytes cobs(const Bytes& plain) {
    Bytes out(fltea::cobs_max_encoded(plain.size()));
    out.resize(fltea::cobs_encode(plain.data(), plain.size(), out.data()));
    return out;
}

// Fills the fields of a message from a test vector. Its record has a line "field NAME VALUE" for each field,
// in the order of the fields.
class RecordReader {
  public:
    explicit RecordReader(const Record& record) {
        for (const std::pair<std::string, std::string>& line : record) {
            if (line.first == "field") fields_.push_back(line.second);
        }
    }

    template <typename T>
    typename std::enable_if<std::is_integral<T>::value>::type operator()(const char* name, T& field) {
        field = static_cast<T>(std::stoll(next(name)));
    }
    template <typename T>
    typename std::enable_if<std::is_enum<T>::value>::type operator()(const char* name, T& field) {
        field = static_cast<T>(std::stoll(next(name)));
    }
    void operator()(const char* name, float& field) {
        const std::string text = next(name);
        char* end = nullptr;
        // strtof() is used, because std::stof() throws for denormal numbers
        field = std::strtof(text.c_str(), &end);
        REQUIRE(!text.empty());
        REQUIRE(*end == 0);
    }
    template <size_t N>
    void operator()(const char* name, uint8_t (&field)[N]) {
        Bytes bytes = from_hex(next(name));
        REQUIRE(bytes.size() == N);
        std::memcpy(field, bytes.data(), N);
    }
    template <size_t N>
    void operator()(const char* name, char (&field)[N]) {
        std::string text = next(name);
        REQUIRE(text.size() <= N);
        std::memset(field, 0, N);
        std::memcpy(field, text.data(), text.size());
    }

    bool empty() const { return used_ == fields_.size(); }

  private:
    std::string next(const char* name) {
        REQUIRE(used_ < fields_.size());
        const std::string& line = fields_[used_++];
        size_t blank = line.find(' ');
        REQUIRE(line.substr(0, blank) == name);
        return blank == std::string::npos ? "" : line.substr(blank + 1);
    }

    std::vector<std::string> fields_;
    size_t used_ = 0;
};

// Encodes the message whose fields a record of a test vector lists.
struct EncodeRecord {
    const Record& record;
    uint16_t sequence;
    uint32_t device_us;
    Bytes wire;

    template <typename Message>
    void message() {
        Message message;
        RecordReader read(record);
        Message::visit_fields(message, read);
        CHECK(read.empty());
        wire.resize(fltea::kMaxWire);
        wire.resize(fltea::encode_message(message, sequence, device_us, wire.data()));
        CHECK(wire.size() == Message::size() + 13);
    }
};

}  // namespace

TEST_CASE("crc32: published values") {
    for (const auto& row : table("crc32.txt")) {
        CAPTURE(row.second);
        Bytes data = from_runs(row.second);
        CHECK(fltea::crc32(data.data(), data.size()) == std::stoul(row.first, nullptr, 16));
    }
}

TEST_CASE("crc32: bytes one by one, and a value in between disturbs nothing") {
    fltea::Crc32 crc;
    for (char c : std::string("123456789")) {
        crc.value();
        crc.add(static_cast<uint8_t>(c));
    }
    CHECK(crc.value() == 0xCBF43926);
}

TEST_CASE("cobs: published examples") {
    for (const auto& row : table("cobs.txt")) {
        CAPTURE(row.first);
        CHECK(cobs(from_runs(row.first)) == from_runs(row.second));
    }
}

TEST_CASE("cobs: no zero inside and never longer than promised") {
    for (size_t n = 0; n < 1100; ++n) {
        CAPTURE(n);
        for (uint8_t fill : {uint8_t(0), uint8_t(1), uint8_t(255)}) {
            Bytes encoded = cobs(Bytes(n, fill));
            CHECK(std::count(encoded.begin(), encoded.end(), 0) == 0);
            CHECK(encoded.size() == (fill ? fltea::cobs_max_encoded(n) : n + 1));
        }
    }
}

TEST_CASE("frame: the good vectors, from bytes and from structs") {
    std::map<int, int> seen;
    for (const Record& record : records("good.txt")) {
        CAPTURE(value_of(record, "name"));
        int type = std::stoi(value_of(record, "type"));
        uint16_t sequence = static_cast<uint16_t>(std::stoul(value_of(record, "sequence")));
        uint32_t device_us = static_cast<uint32_t>(std::stoul(value_of(record, "device_us")));
        Bytes payload = from_hex(value_of(record, "payload"));
        Bytes expected = from_hex(value_of(record, "wire"));

        Bytes out(fltea::kMaxWire);
        out.resize(fltea::encode_frame(static_cast<uint8_t>(type), sequence, device_us, payload.data(),
                                       payload.size(), out.data()));
        CHECK(out == expected);

        ++seen[type];
        EncodeRecord encode = {record, sequence, device_us, {}};
        const bool known = with_message(static_cast<uint8_t>(type), encode);
        const bool has_fields = std::any_of(record.begin(), record.end(), [](const Record::value_type& line) {
            return line.first == "field";
        });
        CHECK(known == has_fields);
        if (known) CHECK(encode.wire == expected);
    }
    for (int type : {1, 2, 3, 4, 5, 6, 200}) CHECK(seen[type] > 0);
}

TEST_CASE("frame: every kind of f32 crosses the wire with its bits") {
    for (uint32_t bits : {0x00000000u, 0x80000000u, 0x00000001u, 0x807FFFFFu, 0x00800000u, 0x7F7FFFFFu,
                          0x7F800000u, 0xFF800000u, 0x7FC00000u, 0xFFC12345u, 0x7F800001u, 0xBFA00000u}) {
        CAPTURE(bits);
        fltea::Estimate sent = fltea::Estimate();
        std::memcpy(&sent.f, &bits, sizeof sent.f);
        Bytes wire(fltea::kMaxWire);
        wire.resize(fltea::encode_message(sent, 1, 2, wire.data()));
        Receiver receiver;
        receiver.feed(wire.data(), wire.size());
        REQUIRE(receiver.frames.size() == 1);
        const Bytes& payload = receiver.frames[0].payload;
        CHECK(Bytes(payload.begin() + 16, payload.begin() + 20) ==
              Bytes{static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8),
                    static_cast<uint8_t>(bits >> 16), static_cast<uint8_t>(bits >> 24)});
        const fltea::Estimate received = message_of<fltea::Estimate>(receiver.frames[0]);
        CHECK(std::memcmp(&received.f, &sent.f, sizeof sent.f) == 0);
    }
}

TEST_CASE("frame: 240 bytes fit into kMaxWire, 241 are refused and nothing is written") {
    Bytes payload(241, 0x55);
    Bytes out(fltea::kMaxWire, 0xEE);
    CHECK(fltea::encode_frame(9, 1, 2, payload.data(), 241, out.data()) == 0);
    CHECK(out == Bytes(fltea::kMaxWire, 0xEE));
    CHECK(fltea::encode_frame(9, 1, 2, payload.data(), 240, out.data()) == fltea::kMaxWire);
    CHECK(out.back() == 0);
    CHECK(std::count(out.begin(), out.end(), 0) == 1);
}

TEST_CASE("frame: without payload the data pointer may be null") {
    uint8_t out[fltea::kMaxWire];
    CHECK(fltea::encode_frame(9, 1, 2, nullptr, 0, out) == 13);
}

TEST_CASE("messages: limits and version") {
    CHECK(size_t(fltea::kMaxPayload) == 240);
    CHECK(size_t(fltea::kMaxFrame) == 251);
    CHECK(size_t(fltea::kMaxWire) == 253);
    CHECK(int(fltea::kProtocolMajor) == 1);
    bool stated = false;
    for (const Record& record : records("good.txt")) {
        for (const auto& line : record) {
            if (line.second.compare(0, 12, "schema_hash ") != 0) continue;
            CHECK(line.second == "schema_hash " + std::to_string(fltea::kSchemaHash));
            stated = true;
        }
    }
    CHECK(stated);
}
