// Makes two things available in Python: the class fltea._native.McapChunks, which writes messages into MCAP
// chunks (host/fltea/recording/part.py), and a function that finds the records in a chunk
// (host/fltea/recording/scan.py).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "chunk_index.hpp"
#include "chunk_writer.hpp"
#include "engine_binding.hpp"

namespace nb = nanobind;

namespace {

using Times = nb::ndarray<const int64_t, nb::ndim<1>, nb::device::cpu>;

const char* text_of(const nb::bytes& bytes) { return static_cast<const char*>(bytes.data()); }

nb::bytes as_text(const std::string& text) { return nb::bytes(text.data(), text.size()); }

uint64_t at(const Times& times, size_t k) { return static_cast<uint64_t>(times(k)); }

class McapChunks {
  public:
    explicit McapChunks(const std::string& compression) : writer_(compression) {}

    void add_record(nb::bytes record) { writer_.add_record(text_of(record), record.size()); }

    void add_message(uint16_t channel, uint32_t sequence, uint64_t log_ns, uint64_t publish_ns,
                     nb::bytes data) {
        writer_.add_message(channel, sequence, log_ns, publish_ns, text_of(data), data.size());
    }

    // Adds messages with bytes from a serial port, one message for each read of the port.
    void add_reads(uint16_t channel, uint32_t sequence, nb::bytes data, const Times& end, const Times& log_ns,
                   const Times& publish_ns) {
        const size_t n = end.shape(0);
        if (log_ns.shape(0) != n || publish_ns.shape(0) != n)
            throw nb::value_error("log_ns and publish_ns must have one time for each read");
        size_t begin = 0;
        for (size_t k = 0; k < n; ++k) {
            if (at(end, k) < begin || at(end, k) > data.size())
                throw nb::value_error(
                    "the ends of the reads must not decrease, and not exceed the number of bytes");
            writer_.add_message(channel, sequence++, at(log_ns, k), at(publish_ns, k), text_of(data) + begin,
                                static_cast<size_t>(at(end, k)) - begin);
            begin = static_cast<size_t>(at(end, k));
        }
    }

    // Adds one message for each line of text, without the line end.
    void add_lines(uint16_t channel, const Times& log_ns, nb::bytes lines) {
        const char *from = text_of(lines), *const end = from + lines.size();
        for (size_t k = 0; k < log_ns.shape(0); ++k) {
            const void* const found =
                from < end ? std::memchr(from, '\n', static_cast<size_t>(end - from)) : nullptr;
            if (!found) throw nb::value_error("fewer lines than times");
            const char* const stop = static_cast<const char*>(found);
            writer_.add_message(channel, 0, at(log_ns, k), at(log_ns, k), from,
                                static_cast<size_t>(stop - from));
            from = stop + 1;
        }
        if (from != end) throw nb::value_error("more lines than times");
    }

    // Ends the chunk in progress, and returns its bytes. The caller has to write them at offset `at` of the
    // file. Returns no bytes if the chunk has no message.
    nb::bytes end(uint64_t at, nb::callable packed) {
        if (!writer_.messages()) return nb::bytes("", 0);
        const nb::bytes found = nb::cast<nb::bytes>(packed(as_text(writer_.records())));
        return as_text(writer_.end(text_of(found), found.size(), at));
    }

    // Returns the summary of all finished chunks: their index records, the first and the last time of a
    // message, the number of chunks, and the number of messages per channel.
    nb::tuple summary() const {
        nb::dict counts;
        for (const auto& one : writer_.counts()) counts[nb::cast(one.first)] = one.second;
        return nb::make_tuple(as_text(writer_.summary()), writer_.first_ns(), writer_.newest_ns(),
                              writer_.chunks(), counts);
    }

    size_t size() const { return writer_.records().size(); }

  private:
    fltea::ChunkWriter writer_;
};

// Returns the records of a decompressed chunk. Each record is seven numbers (ChunkRecord in chunk_index.hpp).
nb::bytes chunk_records(nb::bytes chunk) {
    std::vector<fltea::ChunkRecord> records;
    const fltea::ChunkFault fault =
        fltea::index_chunk(static_cast<const uint8_t*>(chunk.data()), chunk.size(), records);
    if (*fault.what) {
        const std::string text = std::string(fault.what) + ": at byte " + std::to_string(fault.at) +
                                 " of the chunk, it claims " + std::to_string(fault.claimed) +
                                 " bytes, and " + std::to_string(fault.left) + " are left";
        throw nb::value_error(text.c_str());
    }
    return nb::bytes(records.data(), records.size() * sizeof(fltea::ChunkRecord));
}

}  // namespace

void bind_mcap(nb::module_& m) {
    m.def("chunk_records", &chunk_records, nb::arg("chunk"));
    nb::class_<McapChunks>(m, "McapChunks")
        .def(nb::init<const std::string&>(), nb::arg("compression"))
        .def("add_record", &McapChunks::add_record, nb::arg("record"))
        .def("add_message", &McapChunks::add_message, nb::arg("channel"), nb::arg("sequence"),
             nb::arg("log_ns"), nb::arg("publish_ns"), nb::arg("data"))
        .def("add_reads", &McapChunks::add_reads, nb::arg("channel"), nb::arg("sequence"), nb::arg("data"),
             nb::arg("end"), nb::arg("log_ns"), nb::arg("publish_ns"))
        .def("add_lines", &McapChunks::add_lines, nb::arg("channel"), nb::arg("log_ns"), nb::arg("lines"))
        .def("end", &McapChunks::end, nb::arg("at"), nb::arg("packed"))
        .def("summary", &McapChunks::summary)
        .def_prop_ro("size", &McapChunks::size);
}
