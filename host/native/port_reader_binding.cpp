// Makes the reader of many serial ports available in Python as fltea._native.PortReader. Its time stamps do
// not wait for Python's GIL. Python code should use fltea.wire.ports instead.
#include <nanobind/stl/vector.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "decoder_binding.hpp"
#include "port_read_binding.hpp"
#include "port_reader.hpp"

namespace nb = nanobind;

namespace {

using fltea::PortNews;

class PortReader {
  public:
    explicit PortReader(std::size_t capacity) : reader_(capacity) {}

    void add(int port, int descriptor, bool closes, std::int64_t latency_ns) {
        reader_.add(port, descriptor, closes, latency_ns);
    }

    // Returns the time, and a tuple for each port from which something came. The tuple has five elements: the
    // number of the port; the bytes; the columns of its reads (end, host_ns, unix_offset_ns); the number of
    // discarded bytes; and the loss of the port. The loss is the error number and the time of the loss, or
    // None if the port was not lost.
    nb::tuple take(double timeout_s) {
        std::int64_t now_ns = 0;
        std::vector<PortNews> news;
        {
            const nb::gil_scoped_release release;
            now_ns = reader_.take(timeout_s, news);
        }
        nb::list found;
        for (const PortNews& one : news) {
            nb::object lost = nb::none();
            if (one.error) lost = nb::make_tuple(one.error, one.lost.host_ns, one.lost.unix_offset_ns);
            found.append(nb::make_tuple(one.port, nb::bytes(one.bytes.data(), one.bytes.size()),
                                        columns_of(one.reads), one.overflow_bytes, lost));
        }
        return nb::make_tuple(now_ns, found);
    }

    void wake() { reader_.wake(); }

    void close() {
        const nb::gil_scoped_release release;
        reader_.close();
    }

  private:
    fltea::PortReader reader_;
};

}  // namespace

void bind_port_reader(nb::module_& m) {
    nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
        try {
            std::rethrow_exception(thrown);
        } catch (const std::system_error& error) {
            errno = error.code().value();
            PyErr_SetFromErrno(PyExc_OSError);
        }
    });
    m.def("shift_unix_clock", &fltea::shift_unix_clock, nb::arg("ns"));
    nb::class_<fltea::WakeUp>(m, "WakeUp")
        .def(nb::init<>())
        .def("fileno", &fltea::WakeUp::number)
        .def("ring", &fltea::WakeUp::ring)
        .def("clear", &fltea::WakeUp::clear);
    nb::class_<PortReader>(m, "PortReader")
        .def(nb::init<std::size_t>(), nb::arg("capacity"))
        .def("add", &PortReader::add, nb::arg("port"), nb::arg("descriptor"), nb::arg("closes"),
             nb::arg("latency_ns"))
        .def("take", &PortReader::take, nb::arg("timeout_s"))
        .def("wake", &PortReader::wake)
        .def("close", &PortReader::close);
}
