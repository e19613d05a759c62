// The C++ class behind Python's fltea._native.PortDecoder. port_decoder_binding.cpp and round_binding.cpp
// share it.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <vector>

#include "buffer_view.hpp"
#include "numpy_binding.hpp"
#include "port_decoder.hpp"

namespace port_decoder_binding {

namespace nb = nanobind;

using fltea::PortItem;
using fltea::PortRead;
using fltea::Stamp;

using Times = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::device::cpu>;

inline nb::bytes bytes(const PortItem& item) { return nb::bytes(item.bytes, item.size); }

template <typename T>
T* copied(NumpyTable& table, const T* from, std::size_t count) {
    T* const to = table.room<T>(count);
    std::memcpy(to, from, count * sizeof(T));
    return to;
}

// Returns the columns of samples in the order of the Python class RawBlock.
inline nb::tuple columns(const fltea::SampleColumns& samples) {
    const std::size_t n = samples.n;
    NumpyTable table(n * (4 * sizeof(std::int64_t) + 7 * sizeof(std::int16_t)));
    const auto* const sequence = copied(table, samples.sequence, n);
    const auto* const device_us = copied(table, samples.device_us, n);
    const auto* const host_ns = copied(table, samples.host_ns, n);
    const auto* const flags = copied(table, samples.flags, n);
    const auto* const gyro = copied(table, samples.gyro.counts(), 3 * n);
    const auto* const accel = copied(table, samples.accel.counts(), 3 * n);
    const auto* const temperature = copied(table, samples.temperature.counts(), n);
    const nb::tuple wide = nb::make_tuple(n), three_wide = nb::make_tuple(n, 3);
    return nb::make_tuple(table.array(sequence, wide), table.array(device_us, wide),
                          table.array(host_ns, wide), table.array(gyro, three_wide),
                          table.array(accel, three_wide), table.array(temperature, wide),
                          table.array(flags, wide));
}

// Returns an item as a tuple in the form that host/fltea/sources/wire_events.py expects, or None for an item
// kDone, which has no content.
inline nb::object as_tuple(const PortItem& item) {
    switch (item.kind) {
        case PortItem::kDone:
            break;
        case PortItem::kSamples:
            return nb::make_tuple("samples", columns(item.samples));
        case PortItem::kFrame:
            return nb::make_tuple("frame", item.host_ns, item.type, item.sequence, item.device_us,
                                  bytes(item));
        case PortItem::kSameHello:
            return nb::make_tuple("same_hello", item.host_ns);
        case PortItem::kRefusedVersion:
            return nb::make_tuple("refused_version", item.host_ns, bytes(item), item.is_news);
        case PortItem::kBad:
            return nb::make_tuple("bad", item.host_ns, fltea::reason_name(item.reason), bytes(item));
        case PortItem::kTick:
            return nb::make_tuple("tick", item.host_ns);
        case PortItem::kTrouble:
            return nb::make_tuple("trouble", item.host_ns, fltea::trouble_name(item.trouble),
                                  item.unread_bytes);
    }
    return nb::none();
}

class PortDecoder {
  public:
    PortDecoder(std::int64_t silence_ns, std::int64_t tick_ns, std::int64_t repeat_ns)
        : line_({silence_ns, tick_ns, repeat_ns}) {}

    void feed(nb::handle data, const Times& end, const Times& host_ns, const Times& unix_offset_ns,
              std::int64_t now_ns) {
        const BufferView view(data);
        const std::size_t n = end.shape(0);
        if (n == 0 || host_ns.shape(0) != n || unix_offset_ns.shape(0) != n)
            throw nb::value_error("there must be at least one read, and each must have an end and two times");
        reads_.clear();
        std::int64_t before = 0;
        for (std::size_t k = 0; k < n; ++k) {
            if (end(k) < before) throw nb::value_error("the ends of the reads must not decrease");
            before = end(k);
            reads_.push_back({before, {host_ns(k), unix_offset_ns(k)}});
        }
        if (static_cast<std::size_t>(before) != view.size())
            throw nb::value_error("the last read must end with the last byte");
        line_.feed(view.data(), reads_.data(), n, now_ns);
    }

    void feed_one(nb::handle data, std::int64_t host_ns, std::int64_t unix_offset_ns, std::int64_t now_ns) {
        const BufferView view(data);
        const PortRead read = {static_cast<std::int64_t>(view.size()), {host_ns, unix_offset_ns}};
        line_.feed_one(view.data(), read, now_ns);
    }

    nb::object next() { return as_tuple(line_.next()); }

    // Returns five counts: the numbers of bytes, of frames, of refused frames and of openings of the port,
    // and the number of bad blocks for each reason.
    nb::tuple counts() const {
        const fltea::PortCounts& counts = line_.counts();
        nb::dict bad;
        for (const fltea::PortCounts::Bad& one : counts.bad) bad[fltea::reason_name(one.reason)] = one.blocks;
        return nb::make_tuple(counts.bytes, counts.frames, counts.refused, counts.connections, bad);
    }

    fltea::PortDecoder& native() { return line_; }

  private:
    fltea::PortDecoder line_;
    std::vector<PortRead> reads_;
};

}  // namespace port_decoder_binding
