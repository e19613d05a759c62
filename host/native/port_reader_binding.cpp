// fltea._native.PortReader: what comes from many ports, read and stamped without Python's lock.
// fltea.wire.ports is the interface for people.
#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "decoder_binding.hpp"
#include "port_reader.hpp"

namespace nb = nanobind;

namespace {

using fltea::PortNews;
using fltea::PortRead;

class PortReader {
  public:
    explicit PortReader(std::size_t capacity) : reader_(capacity) {
        const nb::module_ numpy = nb::module_::import_("numpy");
        ndarray_ = numpy.attr("ndarray");
        int64_ = numpy.attr("dtype")("int64");
    }

    void add(int port, int descriptor, bool closes, std::int64_t latency_ns) {
        reader_.add(port, descriptor, closes, latency_ns);
    }

    // The time, and for each port with news: its number, bytes, columns of its reads (end, host_ns,
    // unix_offset_ns), how many bytes were thrown away, and None or errno and time of its loss.
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
                                        columns(one.reads), one.overflow_bytes, lost));
        }
        return nb::make_tuple(now_ns, found);
    }

    void wake() { reader_.wake(); }

    void close() {
        const nb::gil_scoped_release release;
        reader_.close();
    }

  private:
    // Arrays in one bytearray, which they keep alive.
    nb::tuple columns(const std::vector<PortRead>& reads) const {
        const std::size_t n = reads.size(), column = n * sizeof(std::int64_t);
        const nb::object buffer =
            nb::steal(PyByteArray_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(3 * column)));
        if (!buffer.is_valid()) nb::raise_python_error();
        char* const bytes = PyByteArray_AsString(buffer.ptr());
        for (std::size_t k = 0; k < n; ++k) {
            const std::int64_t row[] = {reads[k].end, reads[k].stamp.host_ns, reads[k].stamp.unix_offset_ns};
            for (std::size_t c = 0; c < 3; ++c) {
                std::memcpy(bytes + c * column + k * sizeof row[c], &row[c], sizeof row[c]);
            }
        }
        const nb::tuple shape = nb::make_tuple(n);
        return nb::make_tuple(ndarray_(shape, int64_, buffer, 0), ndarray_(shape, int64_, buffer, column),
                              ndarray_(shape, int64_, buffer, 2 * column));
    }

    fltea::PortReader reader_;
    nb::object ndarray_, int64_;
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
    nb::class_<PortReader>(m, "PortReader")
        .def(nb::init<std::size_t>(), nb::arg("capacity"))
        .def("add", &PortReader::add, nb::arg("port"), nb::arg("descriptor"), nb::arg("closes"),
             nb::arg("latency_ns"))
        .def("take", &PortReader::take, nb::arg("timeout_s"))
        .def("wake", &PortReader::wake)
        .def("close", &PortReader::close);
}
