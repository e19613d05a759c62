// Makes the C++ class PortDecoder, which decodes what came from a serial port into items, available in Python
// as fltea._native.PortDecoder (host/fltea/sources/wire_events.py).
#include "port_decoder_binding.hpp"

#include "decoder_binding.hpp"

namespace nb = nanobind;

using port_decoder_binding::PortDecoder;

void bind_port_decoder(nb::module_& m) {
    nb::class_<PortDecoder>(m, "PortDecoder")
        .def(nb::init<std::int64_t, std::int64_t, std::int64_t>(), nb::arg("silence_ns"), nb::arg("tick_ns"),
             nb::arg("repeat_ns"))
        .def(
            "opened",
            [](PortDecoder& self, std::int64_t host_ns, std::int64_t unix_offset_ns) {
                self.native().opened({host_ns, unix_offset_ns});
            },
            nb::arg("host_ns"), nb::arg("unix_offset_ns"))
        .def(
            "failed",
            [](PortDecoder& self, const char* kind, std::int64_t host_ns, std::int64_t unix_offset_ns) {
                return self.native().failed(kind, {host_ns, unix_offset_ns});
            },
            nb::arg("kind"), nb::arg("host_ns"), nb::arg("unix_offset_ns"))
        .def("feed", &PortDecoder::feed, nb::arg("data"), nb::arg("end"), nb::arg("host_ns"),
             nb::arg("unix_offset_ns"), nb::arg("now_ns"))
        .def("feed_one", &PortDecoder::feed_one, nb::arg("data"), nb::arg("host_ns"),
             nb::arg("unix_offset_ns"), nb::arg("now_ns"))
        .def(
            "silent", [](PortDecoder& self, std::int64_t now_ns) { self.native().silent(now_ns); },
            nb::arg("now_ns"))
        .def(
            "pass_time", [](PortDecoder& self, std::int64_t until_ns) { self.native().pass_time(until_ns); },
            nb::arg("until_ns"))
        .def(
            "forgive", [](PortDecoder& self, std::int64_t now_ns) { self.native().forgive(now_ns); },
            nb::arg("now_ns"))
        .def(
            "resume", [](PortDecoder& self, std::int64_t now_ns) { self.native().resume(now_ns); },
            nb::arg("now_ns"))
        .def("accept_hello", [](PortDecoder& self) { self.native().accept_hello(); })
        .def("refuse_hello", [](PortDecoder& self) { return self.native().refuse_hello(); })
        .def("next", &PortDecoder::next)
        .def("counts", &PortDecoder::counts)
        .def_prop_rw(
            "unix_offset_ns", [](PortDecoder& self) { return self.native().unix_offset_ns; },
            [](PortDecoder& self, std::int64_t ns) { self.native().unix_offset_ns = ns; });
}
