// Writes messages into MCAP chunks, and collects the file's summary (the MCAP specification, "Chunk",
// "Message Index" and "Chunk Index").
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace fltea {

// Builds the content of an MCAP record from numbers and strings. Numbers are in little-endian byte order, and
// the length of each string precedes the string.
class RecordText {
  public:
    template <typename T>
    RecordText& put(T value) {
        char bytes[sizeof(T)];
        for (std::size_t i = 0; i < sizeof(T); ++i) bytes[i] = static_cast<char>(value >> 8 * i);
        text_.append(bytes, sizeof(T));
        return *this;
    }

    RecordText& put(const char* data, std::size_t size) {
        text_.append(data, size);
        return *this;
    }

    RecordText& put_text(const std::string& text) {
        return put(static_cast<std::uint32_t>(text.size())).put(text.data(), text.size());
    }

    RecordText& begin(std::uint8_t kind, std::size_t length) {
        return put(kind).put(static_cast<std::uint64_t>(length));
    }

    void clear() { text_.clear(); }
    const std::string& text() const { return text_; }

  private:
    std::string text_;
};

// Writes the chunks of one file. The index of a chunk is sorted by channel number.
class ChunkWriter {
  public:
    // `compression`: MCAP's name of the compression format in which end() receives the records.
    explicit ChunkWriter(const std::string& compression) : compression_(compression) {}

    // Appends a record that is not a message, unchanged.
    void add_record(const char* record, std::size_t size) { records_.put(record, size); }

    void add_message(std::uint16_t channel, std::uint32_t sequence, std::uint64_t log_ns,
                     std::uint64_t publish_ns, const char* data, std::size_t size) {
        const std::uint64_t at = records_.text().size();
        records_.begin(0x05, 22 + size)
            .put(channel)
            .put(sequence)
            .put(log_ns)
            .put(publish_ns)
            .put(data, size);
        start_ns_ = messages_ ? std::min(start_ns_, log_ns) : log_ns;
        end_ns_ = messages_ ? std::max(end_ns_, log_ns) : log_ns;
        ++messages_;
        std::vector<std::pair<std::uint64_t, std::uint64_t>>& index = index_of(channel);
        index.emplace_back(log_ns, at);
    }

    // The records of the chunk in progress, and the number of messages among them.
    const std::string& records() const { return records_.text(); }
    std::size_t messages() const { return messages_; }

    // Ends the chunk, which has at least one message, and returns the bytes to write at offset `at` of the
    // file. `packed`: the compressed records of the chunk.
    std::string end(const char* packed, std::size_t size, std::uint64_t at) {
        const std::uint64_t plain = records_.text().size();
        RecordText out;
        out.begin(0x06, chunk_bytes(size) - kHead).put(start_ns_).put(end_ns_).put(plain);
        // A CRC of 0 means that the chunk has no CRC. It needs none, because the compressed format has its
        // own checksum.
        out.put(std::uint32_t{0}).put_text(compression_);
        out.put(static_cast<std::uint64_t>(size)).put(packed, size);
        note(at - next_at_);
        note(start_ns_ - (chunks_ ? last_ns_ : 0));
        note(end_ns_ - start_ns_);
        note(size);
        note(plain);
        std::size_t channels = 0;
        for (const Index& one : index_) channels += !one.second.empty();
        note(channels);
        for (Index& one : index_) {
            if (one.second.empty()) continue;
            const std::uint32_t bytes = static_cast<std::uint32_t>(16 * one.second.size());
            out.begin(0x07, 6 + bytes).put(one.first).put(bytes);
            for (const auto& entry : one.second) out.put(entry.first).put(entry.second);
            note(one.first);
            note(one.second.size());
            counts_[one.first] += one.second.size();
            one.second.clear();
        }
        first_ns_ = chunks_ ? std::min(first_ns_, start_ns_) : start_ns_;
        newest_ns_ = chunks_ ? std::max(newest_ns_, end_ns_) : end_ns_;
        last_ns_ = start_ns_;
        next_at_ = at + out.text().size();
        ++chunks_;
        messages_ = 0;
        records_.clear();
        return out.text();
    }

    // Statistics of all finished chunks: the times of the first and of the newest message [ns], the number of
    // chunks, and the number of messages per channel.
    std::uint64_t first_ns() const { return first_ns_; }
    std::uint64_t newest_ns() const { return newest_ns_; }
    std::size_t chunks() const { return chunks_; }
    const std::map<std::uint16_t, std::uint64_t>& counts() const { return counts_; }

    // Returns the Chunk Index records of all finished chunks.
    std::string summary() const {
        RecordText out;
        const char* from = noted_.data();
        std::uint64_t at = 0, start_ns = 0;
        for (std::size_t k = 0; k < chunks_; ++k) {
            at += noted(from);
            start_ns += noted(from);
            const std::uint64_t end_ns = start_ns + noted(from), size = noted(from), plain = noted(from);
            const std::size_t channels = static_cast<std::size_t>(noted(from));
            const std::size_t map = 10 * channels;
            out.begin(0x08, 64 + map + compression_.size()).put(start_ns).put(end_ns).put(at);
            out.put(static_cast<std::uint64_t>(chunk_bytes(size))).put(static_cast<std::uint32_t>(map));
            const std::uint64_t index_at = at + chunk_bytes(size);
            at = index_at;
            for (std::size_t c = 0; c < channels; ++c) {
                out.put(static_cast<std::uint16_t>(noted(from))).put(at);
                at += kHead + 6 + 16 * noted(from);
            }
            out.put(at - index_at).put_text(compression_).put(size).put(plain);
        }
        return out.text();
    }

  private:
    typedef std::pair<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> Index;

    static constexpr std::size_t kHead = 9;

    std::size_t chunk_bytes(std::uint64_t packed) const {
        return static_cast<std::size_t>(kHead + 40 + compression_.size() + packed);
    }

    std::vector<std::pair<std::uint64_t, std::uint64_t>>& index_of(std::uint16_t channel) {
        const auto place = std::lower_bound(index_.begin(), index_.end(), channel,
                                            [](const Index& one, std::uint16_t c) { return one.first < c; });
        if (place != index_.end() && place->first == channel) return place->second;
        return index_.insert(place, Index(channel, {}))->second;
    }

    // Appends a number in a form in which each byte holds seven bits of it. The index of the finished chunks
    // is stored in this form until the file ends, because plain numbers would take five times the memory.
    void note(std::uint64_t value) {
        for (; value >= 0x80; value >>= 7) noted_.push_back(static_cast<char>(value | 0x80));
        noted_.push_back(static_cast<char>(value));
    }

    static std::uint64_t noted(const char*& from) {
        std::uint64_t value = 0;
        for (int shift = 0;; shift += 7) {
            const std::uint64_t byte = static_cast<std::uint8_t>(*from++);
            value |= (byte & 0x7F) << shift;
            if (byte < 0x80) return value;
        }
    }

    const std::string compression_;
    RecordText records_;
    std::vector<Index> index_;
    std::size_t messages_ = 0, chunks_ = 0;
    std::uint64_t start_ns_ = 0, end_ns_ = 0;
    std::uint64_t first_ns_ = 0, newest_ns_ = 0, last_ns_ = 0, next_at_ = 0;
    std::map<std::uint16_t, std::uint64_t> counts_;
    std::string noted_;
};

}  // namespace fltea
