// fltea._native.WireLine: decodes what came over a port into items, for Python
// (host/fltea/sources/wire_events.py).
#include "wire_line_binding.hpp"

#include "decoder_binding.hpp"

namespace nb = nanobind;

using wire_line_binding::WireLine;

void bind_wire_line(nb::module_& m) {
    nb::class_<WireLine>(m, "WireLine")
        .def(nb::init<std::int64_t, std::int64_t, std::int64_t>(), nb::arg("silence_ns"), nb::arg("tick_ns"),
             nb::arg("repeat_ns"))
        .def(
            "opened",
            [](WireLine& self, std::int64_t host_ns, std::int64_t unix_offset_ns) {
                self.native().opened({host_ns, unix_offset_ns});
            },
            nb::arg("host_ns"), nb::arg("unix_offset_ns"))
        .def(
            "failed",
            [](WireLine& self, const char* kind, std::int64_t host_ns, std::int64_t unix_offset_ns) {
                return self.native().failed(kind, {host_ns, unix_offset_ns});
            },
            nb::arg("kind"), nb::arg("host_ns"), nb::arg("unix_offset_ns"))
        .def("feed", &WireLine::feed, nb::arg("data"), nb::arg("end"), nb::arg("host_ns"),
             nb::arg("unix_offset_ns"), nb::arg("now_ns"))
        .def("feed_one", &WireLine::feed_one, nb::arg("data"), nb::arg("host_ns"), nb::arg("unix_offset_ns"),
             nb::arg("now_ns"))
        .def(
            "silent", [](WireLine& self, std::int64_t now_ns) { self.native().silent(now_ns); },
            nb::arg("now_ns"))
        .def(
            "pass_time", [](WireLine& self, std::int64_t until_ns) { self.native().pass_time(until_ns); },
            nb::arg("until_ns"))
        .def(
            "forgive", [](WireLine& self, std::int64_t now_ns) { self.native().forgive(now_ns); },
            nb::arg("now_ns"))
        .def(
            "resume", [](WireLine& self, std::int64_t now_ns) { self.native().resume(now_ns); },
            nb::arg("now_ns"))
        .def("accept_hello", [](WireLine& self) { self.native().accept_hello(); })
        .def("refuse_hello", [](WireLine& self) { return self.native().refuse_hello(); })
        .def("next", &WireLine::next)
        .def("counts", &WireLine::counts)
        .def_prop_rw(
            "unix_offset_ns", [](WireLine& self) { return self.native().unix_offset_ns; },
            [](WireLine& self, std::int64_t ns) { self.native().unix_offset_ns = ns; });
}
