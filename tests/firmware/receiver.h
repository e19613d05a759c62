// A receiver of frames that only the tests use. It was written from protocol/README.md, and not from the
// host's decoder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include "messages.h"

struct Frame {
    uint8_t type;
    uint16_t sequence;
    uint32_t device_us;
    std::vector<uint8_t> payload;
};

// Calls use.message<Message>() with the struct for this message type. Returns false if there is no such type.
template <typename Use>
bool with_message(uint8_t type, Use& use) {
    switch (type) {
        case fltea::Hello::type():
            use.template message<fltea::Hello>();
            return true;
        case fltea::Sample::type():
            use.template message<fltea::Sample>();
            return true;
        case fltea::Status::type():
            use.template message<fltea::Status>();
            return true;
        case fltea::Fault::type():
            use.template message<fltea::Fault>();
            return true;
        case fltea::Estimate::type():
            use.template message<fltea::Estimate>();
            return true;
        case fltea::Estimator::type():
            use.template message<fltea::Estimator>();
            return true;
        case fltea::Fit::type():
            use.template message<fltea::Fit>();
            return true;
        case fltea::Spectrum::type():
            use.template message<fltea::Spectrum>();
            return true;
        default:
            return false;
    }
}

struct LeastPayload {
    size_t bytes;

    template <typename Message>
    void message() {
        bytes = Message::least();
    }
};

inline uint32_t little_endian(const uint8_t* bytes, size_t n) {
    uint32_t value = 0;
    for (size_t i = n; i-- > 0;) value = value << 8 | bytes[i];
    return value;
}

// Returns the CRC-32, computed one bit at a time from the polynomial, without the firmware's table.
inline uint32_t plain_crc32(const uint8_t* bytes, size_t n) {
    uint32_t state = 0xFFFFFFFFu;
    for (size_t i = 0; i < n; ++i) {
        state ^= bytes[i];
        for (int bit = 0; bit < 8; ++bit) state = (state >> 1) ^ ((state & 1) ? 0xEDB88320u : 0u);
    }
    return ~state;
}

class Receiver {
  public:
    std::vector<Frame> frames;  // valid frames of known types
    // all frames with a right CRC, also of unknown types and other versions
    std::vector<Frame> intact;
    // number of blocks for each kind of error; "frames" counts the valid frames
    std::map<std::string, int> counts;
    int refused = 0;  // intact HELLOs of another version

    void feed(const uint8_t* bytes, size_t n) {
        for (size_t i = 0; i < n; ++i) feed(bytes[i]);
    }
    void feed(uint8_t byte) {
        if (byte == 0) {
            if (!skipping_ && !block_.empty()) count(judge());
            block_.clear();
            skipping_ = false;
            first_ = false;
        } else if (!skipping_) {
            block_.push_back(byte);
            if (block_.size() <= kMaxBlock) return;
            count("oversize");
            skipping_ = true;
        }
    }

    // Returns the number of blocks that were judged so far, with any result. A block is the bytes between two
    // zeros.
    int judged() const {
        int total = refused;
        for (const auto& reason : counts) total += reason.second;
        return total;
    }

  private:
    static constexpr size_t kMaxBlock = 252;

    // Damage in the first block (the bytes before the first zero) is counted as "partial": the block may have
    // begun before the port was opened.
    void count(const std::string& reason) {
        if (reason == "refused") {
            ++refused;
            return;
        }
        const bool damage = reason == "oversize" || reason == "cobs" || reason == "short" || reason == "crc";
        ++counts[first_ && damage ? "partial" : reason];
    }

    bool decode(std::vector<uint8_t>& plain) const {
        for (size_t i = 0; i < block_.size();) {
            const size_t code = block_[i];
            if (i + code > block_.size()) return false;
            plain.insert(plain.end(), block_.begin() + static_cast<std::ptrdiff_t>(i + 1),
                         block_.begin() + static_cast<std::ptrdiff_t>(i + code));
            i += code;
            if (code < 255 && i < block_.size()) plain.push_back(0);
        }
        return true;
    }

    std::string judge() {
        std::vector<uint8_t> plain;
        if (!decode(plain)) return "cobs";
        if (plain.size() < 11) return "short";
        const size_t end = plain.size() - 4;
        if (plain_crc32(plain.data(), end) != little_endian(&plain[end], 4)) return "crc";
        const Frame frame = {
            plain[0], static_cast<uint16_t>(little_endian(&plain[1], 2)), little_endian(&plain[3], 4),
            std::vector<uint8_t>(plain.begin() + 7, plain.begin() + static_cast<std::ptrdiff_t>(end))};
        intact.push_back(frame);
        if (frame.type == fltea::Hello::type() && frame.payload.size() >= 6 &&
            !fltea::can_read(frame.payload[0], frame.payload[1], little_endian(&frame.payload[2], 4))) {
            return "refused";
        }
        LeastPayload least = {0};
        if (!with_message(frame.type, least)) return "unknown_type";
        if (frame.payload.size() < least.bytes) return "length";
        frames.push_back(frame);
        return "frames";
    }

    std::vector<uint8_t> block_;
    bool skipping_ = false;
    bool first_ = true;
};

// Visits the fields of a message, and reads each of them in order from the payload of a frame.
class PayloadReader {
  public:
    explicit PayloadReader(const std::vector<uint8_t>& payload) : next_(payload.data()) {}

    template <typename T>
    typename std::enable_if<std::is_integral<T>::value || std::is_enum<T>::value>::type operator()(
        const char*, T& field) {
        field = static_cast<T>(little_endian(next_, sizeof field));
        next_ += sizeof field;
    }
    void operator()(const char*, float& field) {
        const uint32_t bits = little_endian(next_, sizeof bits);
        std::memcpy(&field, &bits, sizeof field);
        next_ += sizeof field;
    }
    template <typename Byte, size_t N>
    void operator()(const char*, Byte (&field)[N]) {
        std::memcpy(field, next_, N);
        next_ += N;
    }

  private:
    const uint8_t* next_;
};

template <typename Message>
Message message_of(const Frame& frame) {
    Message message;
    std::vector<uint8_t> payload(frame.payload);
    if (payload.size() < Message::size()) payload.resize(Message::size());
    PayloadReader read(payload);
    Message::visit_fields(message, read);
    return message;
}
