// Makes the C++ class Round available in Python as fltea._native.Round (host/fltea/service/port_loop.py). The
// class processes all devices on serial ports, without Python's GIL.
#include <nanobind/nanobind.h>

#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "device_binding.hpp"
#include "port_decoder_binding.hpp"
#include "port_read_binding.hpp"
#include "round.hpp"

namespace nb = nanobind;

namespace {

using fltea::PortStop;
using fltea::PortStream;
using fltea::RunRows;

// Converts the rows of samples that wait for Python to arrays, one for each column, in the order of RunRows.
class Columns {
  public:
    explicit Columns(const RunRows& rows) : rows_(rows), table_(bytes_of(rows)) {}

    template <typename T>
    nb::object next(std::size_t width, bool is_flat = false) {
        const std::vector<char>& from = rows_.column(next_++);
        T* const to = table_.template room<T>(from.size() / sizeof(T));
        table_.template room<char>((8 - from.size() % 8) % 8);
        if (!from.empty()) std::memcpy(to, from.data(), from.size());
        return table_.array(to, is_flat ? nb::make_tuple(rows_.rows()) : nb::make_tuple(rows_.rows(), width));
    }

  private:
    // Returns the total size of the columns. Each column begins at a multiple of 8 bytes.
    static std::size_t bytes_of(const RunRows& rows) {
        std::size_t bytes = 0;
        for (std::size_t i = 0; i < rows.columns(); ++i) bytes += (rows.column(i).size() + 7) / 8 * 8;
        return bytes;
    }

    const RunRows& rows_;
    NumpyTable table_;
    std::size_t next_ = 0;
};

// Returns the fields of the Python class Rows: the arrival times; the columns of samples; and for each sensor
// the columns of its tracker and the columns of the algorithm's estimates. The estimates are None while the
// sensor has none; a sensor without samples is None.
nb::tuple as_tuple(const RunRows& rows) {
    const fltea::RunShape& shape = rows.shape();
    Columns columns(rows);
    const nb::object arrived_ns = columns.next<std::int64_t>(1, true);
    nb::list samples;
    for (int i = 0; i < 3; ++i) samples.append(columns.next<std::int64_t>(1, true));
    samples.append(columns.next<double>(shape[0]));
    samples.append(shape[1] != 0 ? columns.next<double>(shape[1]) : nb::object(nb::none()));
    samples.append(shape[2] != 0 ? columns.next<double>(1, true) : nb::object(nb::none()));
    samples.append(shape[3] != 0 ? columns.next<std::int64_t>(1, true) : nb::object(nb::none()));
    nb::list sensors;
    for (std::size_t i = 4; i < shape.size(); i += 3) {
        const std::size_t axes = shape[i];
        if (axes == 0) {
            sensors.append(nb::none());
            continue;
        }
        nb::list tracked;
        for (int c = 0; c < fltea::kTrackedColumns; ++c) tracked.append(columns.next<double>(axes));
        tracked.append(columns.next<std::uint8_t>(axes));
        nb::object bank = nb::none();
        if (shape[i + 2] != 0) {
            nb::list found;
            for (int c = 0; c < fltea::kLaneInnovationStd; ++c) found.append(columns.next<double>(axes));
            for (int c = 0; c < 2; ++c) found.append(columns.next<std::uint8_t>(axes));
            bank = found;
        }
        sensors.append(nb::make_tuple(tracked, bank));
    }
    return nb::make_tuple(arrived_ns, nb::make_tuple(0, nb::tuple(samples), sensors));
}

class Round {
  public:
    Round(std::size_t capacity, std::int64_t tick_ns, std::size_t texts) : round_(capacity, tick_ns, texts) {}

    // Adds a port. Ports are numbered in the order in which they are added.
    void add(nb::object wire, nb::object device, std::int64_t latency_ns) {
        auto& of_device = nb::cast<device_binding::Device&>(device);
        auto& of_wire = nb::cast<port_decoder_binding::PortDecoder&>(wire);
        kept_.append(nb::make_tuple(wire, device));
        round_.add(std::make_unique<PortStream>(of_wire.native(), of_device.native(), of_device.printers()),
                   &of_device.printers(), latency_ns);
    }

    void open(int port, int descriptor, bool closes, std::int64_t latency_ns) {
        round_.reader().add(port, descriptor, closes, latency_ns);
    }
    void touch(std::size_t port, std::int64_t now_ns) { at(port), round_.touch(port, now_ns); }
    void end(std::size_t port) { at(port), round_.end(port); }
    void wants(std::size_t port, bool rows, bool text, bool reads, std::int64_t patience_ns) {
        PortStream& line = at(port);
        line.wants_rows = rows;
        line.wants_text = text;
        line.wants_reads = reads;
        line.patience_ns = patience_ns;
    }
    bool is_waiting(std::size_t port) { return at(port).is_waiting(); }
    std::int64_t now_ns(std::size_t port) { return at(port).now_ns(); }
    std::int64_t overflow_bytes(std::size_t port) { return at(port).overflow_bytes; }

    // Runs a round: waits until one of the ports has bytes or is due, and processes what has come
    // (fltea::Round::run). Returns the printed texts and the events. Each text has its bytes, and for each
    // device the arrival time and the number of its records. Each event has its port, its kind and its
    // details.
    nb::tuple run(double timeout_s) {
        happened_.clear();
        {
            const nb::gil_scoped_release release;
            round_.run(timeout_s, happened_);
        }
        nb::list printed;
        for (fltea::Text& text : round_.texts()) {
            nb::list parts;
            for (const fltea::PrintedPart& one : text.parts)
                parts.append(nb::make_tuple(one.arrived_ns, one.records));
            printed.append(nb::make_tuple(nb::bytes(text.bytes.data(), text.bytes.size()), parts));
            text.bytes.clear();
            text.parts.clear();
        }
        nb::list happened;
        for (const fltea::Happened& one : happened_) {
            PortStream& line = round_.stream(static_cast<std::size_t>(one.port));
            const std::string& fault = round_.fault(static_cast<std::size_t>(one.port));
            const nb::object what =
                one.stop == PortStop::kFault ? nb::object(nb::str(fault.c_str())) : told(line, one.stop);
            happened.append(nb::make_tuple(one.port, static_cast<int>(one.stop), what));
        }
        return nb::make_tuple(printed, happened);
    }

    std::int64_t waited_ns() {
        const std::int64_t found = round_.waited_ns();
        round_.forget_waited();
        return found;
    }
    void wake() { round_.reader().wake(); }
    void close() {
        const nb::gil_scoped_release release;
        round_.reader().close();
    }

  private:
    PortStream& at(std::size_t port) {
        if (port >= round_.size()) throw nb::index_error("no such port");
        return round_.stream(port);
    }

    static nb::object told(PortStream& line, PortStop stop) {
        switch (stop) {
            case PortStop::kItem:
                return port_decoder_binding::as_tuple(line.item());
            case PortStop::kStop: {
                const fltea::Advanced& found = line.advanced();
                return nb::make_tuple(static_cast<int>(found.stop), line.stopped_ns(),
                                      device_binding::told(line.device(), line.samples(), found));
            }
            case PortStop::kRows: {
                const nb::tuple rows = as_tuple(line.rows());
                line.rows().clear();
                return nb::make_tuple(line.is_unprinted(), rows);
            }
            case PortStop::kReads: {
                const fltea::PortNews& news = line.reads();
                const nb::tuple columns = columns_of(news.reads);
                const nb::tuple reads = nb::make_tuple(nb::bytes(news.bytes.data(), news.bytes.size()),
                                                       // the bytes and their times, in the order of the
                                                       // fields of the Python class Reads
                                                       columns[0], columns[1], columns[2]);
                line.reads() = fltea::PortNews();
                return reads;
            }
            case PortStop::kLost: {
                const fltea::PortNews& news = line.news();
                return nb::make_tuple(news.error, news.lost.host_ns, news.lost.unix_offset_ns,
                                      line.has_worked());
            }
            case PortStop::kNothing:
            case PortStop::kFault:
                break;
        }
        return nb::none();
    }

    fltea::Round round_;
    std::vector<fltea::Happened> happened_;
    nb::list kept_;  // keeps those Python objects alive to which the ports point
};

}  // namespace

void bind_round(nb::module_& m) {
    nb::class_<Round>(m, "Round")
        .def(nb::init<std::size_t, std::int64_t, std::size_t>(), nb::arg("capacity"), nb::arg("tick_ns"),
             nb::arg("texts"))
        .def("add", &Round::add, nb::arg("wire"), nb::arg("device"), nb::arg("latency_ns"))
        .def("open", &Round::open, nb::arg("port"), nb::arg("descriptor"), nb::arg("closes"),
             nb::arg("latency_ns"))
        .def("touch", &Round::touch, nb::arg("port"), nb::arg("now_ns"))
        .def("end", &Round::end, nb::arg("port"))
        .def("wants", &Round::wants, nb::arg("port"), nb::arg("rows"), nb::arg("text"), nb::arg("reads"),
             nb::arg("patience_ns"))
        .def("is_waiting", &Round::is_waiting, nb::arg("port"))
        .def("now_ns", &Round::now_ns, nb::arg("port"))
        .def("overflow_bytes", &Round::overflow_bytes, nb::arg("port"))
        .def("run", &Round::run, nb::arg("timeout_s"))
        .def("waited_ns", &Round::waited_ns)
        .def("wake", &Round::wake)
        .def("close", &Round::close);
}
