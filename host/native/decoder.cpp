#include "decoder.hpp"

#include <algorithm>
#include <cstring>

#include "crc32_table.hpp"

namespace fltea {

namespace {

constexpr std::size_t kHeader = 7;
constexpr std::size_t kCrc = 4;
// Total size of the fields with which the HELLO of every protocol version begins. These are the major
// version, the minor version and the schema hash.
constexpr std::size_t kVersion = 6;
constexpr std::size_t kSampleBlock = kHeader + Sample::size() + kCrc + 1;

std::uint16_t load_u16(const std::uint8_t* bytes) {
    return static_cast<std::uint16_t>(bytes[0] | bytes[1] << 8);
}

// A visitor for the fields of a SAMPLE (messages.h). It reads each field from the payload.
class FieldReader {
  public:
    explicit FieldReader(const std::uint8_t* payload) : next_(payload) {}

    void operator()(const char*, std::int16_t& field) {
        field = static_cast<std::int16_t>(load_u16(next_));
        next_ += 2;
    }
    void operator()(const char*, std::uint8_t& field) { field = *next_++; }

  private:
    const std::uint8_t* next_;
};

// Decodes COBS in place, so that the frame begins at block[1]. As a frame is shorter than 255 bytes, no COBS
// code is 0xFF. Every code except the first therefore replaces a 0x00, and no byte has to be moved. Returns
// false if the block is not valid COBS.
bool undo_cobs(std::uint8_t* block, std::size_t n) {
    static_assert(Decoder::kMaxBlock < 255, "a code of 0xFF would stand for no 0x00");
    std::size_t at = 0;
    while (at < n) {
        const std::size_t code = block[at];
        // A COBS code of 0 would cause an endless loop. Such a code can appear only if the bytes are those of
        // a bytearray to which another thread writes while they are decoded here.
        if (code == 0) return false;
        block[at] = 0;
        at += code;
    }
    return at == n;
}

// Writes the size of the smallest payload of a message type to `least`. Returns false if this protocol
// version has no such type.
bool least_payload(std::uint8_t type, std::size_t& least) {
    switch (type) {
        case Hello::type():
            least = Hello::least();
            return true;
        case Sample::type():
            least = Sample::least();
            return true;
        case Status::type():
            least = Status::least();
            return true;
        case Fault::type():
            least = Fault::least();
            return true;
        case Estimate::type():
            least = Estimate::least();
            return true;
        case Estimator::type():
            least = Estimator::least();
            return true;
        case Fit::type():
            least = Fit::least();
            return true;
        case Spectrum::type():
            least = Spectrum::least();
            return true;
        default:
            return false;
    }
}

// Returns why an undamaged frame cannot be used, or Reason::none if it can be used.
Reason judge_payload(std::uint8_t type, const std::uint8_t* payload, std::size_t n) {
    if (type == Hello::type() && is_other_version(payload, n)) return Reason::none;
    std::size_t least = 0;
    if (!least_payload(type, least)) return Reason::unknown_type;
    return n >= least ? Reason::none : Reason::length;
}

// Whether `reason` for a bad frame can also arise when only a part of a good frame was received.
bool may_be_cut(Reason reason) {
    return reason == Reason::oversize || reason == Reason::cobs || reason == Reason::short_ ||
           reason == Reason::crc;
}

}  // namespace

const char* reason_name(Reason reason) {
    switch (reason) {
        case Reason::none:
            return nullptr;
        case Reason::partial:
            return "partial";
        case Reason::oversize:
            return "oversize";
        case Reason::cobs:
            return "cobs";
        case Reason::short_:
            return "short";
        case Reason::crc:
            return "crc";
        case Reason::unknown_type:
            return "unknown_type";
        case Reason::length:
            return "length";
    }
    return nullptr;
}

bool is_other_version(const std::uint8_t* payload, std::size_t n) {
    return n >= kVersion && !can_read(payload[0], payload[1], load_u32(payload + 2));
}

void Decoder::bad(Reason reason, const std::uint8_t* block, std::size_t n, std::int64_t end,
                  Decoded& found) const {
    OtherRow other = {};
    other.row = found.samples.size();
    other.end = end;
    other.reason = attaching_ && may_be_cut(reason) ? Reason::partial : reason;
    other.offset = found.bytes.size();
    other.size = n;
    found.bytes.insert(found.bytes.end(), block, block + n);
    found.others.push_back(other);
}

void Decoder::judge(const std::uint8_t* block, std::size_t n, std::int64_t end, Decoded& found) const {
    std::uint8_t plain[kMaxBlock];
    // Nearly every frame is a SAMPLE. The compiler knows its length, so it can copy the bytes without calling
    // memcpy.
    if (n == kSampleBlock) {
        std::memcpy(plain, block, kSampleBlock);
    } else {
        std::memcpy(plain, block, n);
    }
    if (!undo_cobs(plain, n)) return bad(Reason::cobs, block, n, end, found);
    const std::uint8_t* frame = plain + 1;
    if (n - 1 < kHeader + kCrc) return bad(Reason::short_, block, n, end, found);
    const std::size_t before_crc = n - 1 - kCrc;
    if (fast_crc32(frame, before_crc) != load_u32(frame + before_crc)) {
        return bad(Reason::crc, block, n, end, found);
    }
    const std::uint8_t type = frame[0];
    const std::uint8_t* payload = frame + kHeader;
    const std::size_t size = before_crc - kHeader;
    const Reason reason = judge_payload(type, payload, size);
    if (reason != Reason::none) return bad(reason, block, n, end, found);
    if (type == Sample::type()) {
        SampleRow row;
        row.end = end;
        row.sequence = load_u16(frame + 1);
        row.device_us = load_u32(frame + 3);
        // Fields of the message that an older device does not send are set to 0. The buffer has room for any
        // message.
        if (size < Sample::size()) std::memset(plain + 1 + kHeader + size, 0, Sample::size() - size);
        FieldReader read(payload);
        Sample::visit_fields(row.sample, read);
        found.samples.push_back(row);
        return;
    }
    OtherRow other = {};
    other.row = found.samples.size();
    other.end = end;
    other.type = type;
    other.sequence = load_u16(frame + 1);
    other.device_us = load_u32(frame + 3);
    other.offset = found.bytes.size();
    other.size = size;
    found.bytes.insert(found.bytes.end(), payload, payload + size);
    found.others.push_back(other);
}

void Decoder::feed(const std::uint8_t* data, std::size_t n, Decoded& found) {
    found.samples.reserve(found.samples.size() + n / (kSampleBlock + 1) + 1);
    for (std::size_t at = 0; at < n;) {
        // `room` is the number of bytes by which the block may still grow. If the block grows by that many
        // bytes, the next byte must be its closing 0x00.
        const std::size_t room = discarding_ ? n : kMaxBlock - pending_;
        const std::size_t reach = std::min(n - at, room + 1);
        const void* zero = std::memchr(data + at, 0, reach);
        const std::size_t length =
            zero ? static_cast<std::size_t>(static_cast<const std::uint8_t*>(zero) - (data + at)) : reach;
        const std::size_t next = at + length + (zero ? 1 : 0);
        const std::int64_t end = static_cast<std::int64_t>(next);
        if (discarding_) {
            discarding_ = !zero;
        } else if (!zero || pending_) {
            const std::size_t taken = std::min(length, room);
            std::memcpy(block_ + pending_, data + at, taken);
            pending_ += taken;
            if (zero) {
                judge(block_, pending_, end, found);
                pending_ = 0;
            } else if (length > room) {
                bad(Reason::oversize, block_, pending_, end, found);
                pending_ = 0;
                discarding_ = true;
            }
        } else if (length) {  // if the length is 0, this is a further 0x00 between two frames
            judge(data + at, length, end, found);
        }
        if (zero) attaching_ = false;
        at = next;
    }
}

}  // namespace fltea
