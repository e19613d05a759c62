// Compares the host's decoder with the receiver that the tests use, which was written from protocol/README.md
// alone.
#pragma once

#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "../firmware/receiver.h"
#include "decoder.hpp"

namespace decoder_check {

typedef std::vector<uint8_t> Bytes;

inline bool same_sample(const fltea::SampleRow& row, const Frame& frame) {
    const fltea::Sample sample = message_of<fltea::Sample>(frame);
    return frame.sequence == row.sequence && frame.device_us == row.device_us &&
           sample.gyro_x == row.sample.gyro_x && sample.gyro_y == row.sample.gyro_y &&
           sample.gyro_z == row.sample.gyro_z && sample.accel_x == row.sample.accel_x &&
           sample.accel_y == row.sample.accel_y && sample.accel_z == row.sample.accel_z &&
           sample.temperature == row.sample.temperature && sample.flags == row.sample.flags;
}

// Collects what the decoder returns in all its calls for one stream. fault() compares this with the results
// of the receiver (../firmware/receiver.h), which has received the same stream.
class Comparison {
  public:
    explicit Comparison(const Bytes& stream) : stream_(stream) {}

    // Adds what one call decoded from the bytes `from` to `to` of the stream.
    void add(const fltea::Decoded& found, size_t from, size_t to) {
        size_t row = 0;
        for (const fltea::OtherRow& other : found.others) {
            for (; row < other.row && row < found.samples.size(); ++row) sample(found.samples[row], from);
            note(row == other.row, "row");
            if (other.size > found.bytes.size() || other.offset > found.bytes.size() - other.size) {
                note(false, "part of bytes");
                return;
            }
            const uint8_t* bytes = found.bytes.data() + other.offset;
            const size_t end = position(other.end, from);
            other.reason == fltea::Reason::none ? intact(other, bytes) : bad(other, bytes, end);
        }
        for (; row < found.samples.size(); ++row) sample(found.samples[row], from);
        note(last_end_ <= to, "end within its call");
    }

    // Returns the first difference from the receiver's results in words, or an empty text if there is none.
    std::string fault(const Receiver& receiver) {
        note(counts_ == receiver.counts, "counts");
        note(refused_ == receiver.refused, "refused");
        note(frames_.size() == receiver.frames.size(), "number of frames");
        if (!fault_.empty()) return fault_;
        for (size_t i = 0; i < frames_.size(); ++i) {
            const Frame& expected = receiver.frames[i];
            const Found& found = frames_[i];
            if (found.is_sample) {
                note(expected.type == fltea::Sample::type() && same_sample(found.row, expected), "sample");
            } else {
                note(expected.type == found.frame.type && expected.type != fltea::Sample::type() &&
                         expected.sequence == found.frame.sequence &&
                         expected.device_us == found.frame.device_us &&
                         expected.payload == found.frame.payload,
                     "frame");
            }
        }
        return fault_;
    }

  private:
    struct Found {
        bool is_sample;
        fltea::SampleRow row;
        Frame frame;
    };

    void note(bool holds, const char* what) {
        if (!holds && fault_.empty()) fault_ = what;
    }

    size_t position(int64_t end, size_t from) {
        const size_t here = from + static_cast<size_t>(end);
        note(end > 0 && here > last_end_ && here <= stream_.size(), "end");
        last_end_ = here;
        return here;
    }

    void sample(const fltea::SampleRow& row, size_t from) {
        const size_t end = position(row.end, from);
        note(end >= 1 && end <= stream_.size() && stream_[end - 1] == 0, "end of a sample");
        frames_.push_back(Found{true, row, Frame()});
        ++counts_["frames"];
    }

    void intact(const fltea::OtherRow& other, const uint8_t* payload) {
        const bool refused = other.type == fltea::Hello::type() && other.size >= 6 &&
                             !fltea::can_read(payload[0], payload[1], little_endian(payload + 2, 4));
        if (refused) {
            ++refused_;
            return;
        }
        frames_.push_back(
            Found{false, fltea::SampleRow(),
                  Frame{other.type, other.sequence, other.device_us, Bytes(payload, payload + other.size)}});
        ++counts_["frames"];
    }

    void bad(const fltea::OtherRow& other, const uint8_t* block, size_t end) {
        ++counts_[fltea::reason_name(other.reason)];
        note(other.size > 0 && other.size < end &&
                 std::memcmp(block, stream_.data() + end - 1 - other.size, other.size) == 0,
             "bytes of a bad block");
    }

    const Bytes& stream_;
    std::vector<Found> frames_;
    std::map<std::string, int> counts_;
    int refused_ = 0;
    size_t last_end_ = 0;
    std::string fault_;
};

}  // namespace decoder_check

// Feeds the stream to the decoder in chunks of the sizes that `next_size()` gives. Each chunk is in separate
// memory, so that the sanitizer detects a read beyond it. Returns the first difference from the receiver's
// results in words, or an empty text if there is none.
template <typename NextSize>
std::string compare_with_receiver(const std::vector<uint8_t>& stream, NextSize next_size) {
    Receiver receiver;
    receiver.feed(stream.data(), stream.size());
    decoder_check::Comparison comparison(stream);
    fltea::Decoder decoder;
    for (size_t at = 0; at < stream.size();) {
        const size_t rest = stream.size() - at;
        const size_t size = next_size();
        const size_t n = size < rest ? size : rest;
        const std::vector<uint8_t> chunk(stream.data() + at, stream.data() + at + n);
        fltea::Decoded found;
        decoder.feed(chunk.data(), n, found);
        if (decoder.pending() > fltea::Decoder::kMaxBlock) return "pending";
        comparison.add(found, at, at + n);
        at += n;
    }
    return comparison.fault(receiver);
}
