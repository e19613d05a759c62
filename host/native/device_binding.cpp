// Makes the C++ class Device available in Python as fltea._native.Device (host/fltea/stream/decode.py). The
// class processes all samples of a device.
#include "device_binding.hpp"

namespace nb = nanobind;

namespace {

using device_binding::Device;
using device_binding::known;

std::vector<std::int64_t> unix_times(const std::vector<std::int64_t>& seq,
                                     const std::vector<std::int64_t>& us, const std::vector<std::int64_t>& ns,
                                     fltea::Timebase& timebase) {
    std::vector<std::int64_t> found;
    for (size_t i = 0; i < seq.size(); ++i) found.push_back(timebase.add(seq[i], us[i], ns[i]));
    return found;
}

}  // namespace

void bind_device(nb::module_& m) {
    m.attr("CLOCK_TOLERANCE") = fltea::SequenceTracker::kClockTolerance;
    m.def(
        "stands_before_sample",
        [](int stop) { return fltea::stands_before_sample(static_cast<fltea::Stop>(stop)); },
        nb::arg("stop"));
    nb::class_<fltea::TrackerPart>(m, "TrackerPart");
    nb::class_<fltea::SumsPart>(m, "SumsPart");
    nb::class_<fltea::BankPart>(m, "BankPart");
    nb::class_<Device>(m, "Device")
        .def(nb::init<>())
        .def("on_hello", &Device::on_hello, nb::arg("rate_hz"), nb::arg("longest_gap"),
             nb::arg("is_another_boot"), nb::arg("is_another_sensor"), nb::arg("scales"))
        .def("forget_hello", &Device::forget_hello)
        .def_prop_ro("knows_hello", &Device::knows_hello)
        .def("on_break", &Device::on_break, nb::arg("reason"))
        .def("begin", &Device::begin, nb::arg("offset_ns"), nb::arg("sensors"))
        .def("set_waits", &Device::set_waits, nb::arg("sensor"), nb::arg("waits"))
        .def("window_left", &Device::window_left, nb::arg("sensor"))
        .def("set_printers", &Device::set_printers, nb::arg("printers"))
        .def("advance", &Device::advance, nb::arg("raw"), nb::arg("next"))
        .def_prop_ro("counts", &Device::counts)
        .def("note_lost", &Device::note_lost, nb::arg("count"))
        .def_prop_ro("newest", &Device::newest)
        .def_prop_ro("moment", &Device::moment)
        .def_prop_ro("rate_hz", &Device::rate_hz)
        .def_prop_ro("clock_ppm", &Device::clock_ppm)
        .def_prop_rw(
            "stats_due_ns", [](Device& self) { return self.native().stats_due_ns; },
            [](Device& self, std::int64_t ns) { self.native().stats_due_ns = ns; })
        .def_prop_rw(
            "fit_due", [](Device& self) { return self.native().fit_due; },
            [](Device& self, std::int64_t seq) { self.native().fit_due = seq; })
        .def_prop_rw(
            "fit_counts", [](Device& self) { return self.native().fit_counts; },
            [](Device& self, std::int64_t seq) { self.native().fit_counts = seq; });
    m.def(
        "fit_clock",
        [](const std::vector<double>& device, const std::vector<double>& delay) {
            if (device.size() != delay.size() || device.size() < 2)
                throw nb::value_error("a clock fit needs two arrivals, each with its time and its delay");
            std::vector<fltea::Arrival> arrivals(device.size());
            for (size_t i = 0; i < device.size(); ++i) arrivals[i] = {device[i], delay[i]};
            const fltea::ClockFit fit = fltea::fit_clock_with_error(arrivals, 0);
            return std::make_tuple(fit.centre.device, fit.centre.delay, fit.slope, fit.slope_std);
        },
        nb::arg("device"), nb::arg("delay"));
    nb::class_<fltea::Timebase>(m, "Timebase")
        .def(nb::init<std::int64_t>(), nb::arg("offset_ns"))
        .def("add",
             [](fltea::Timebase& self, const std::vector<std::int64_t>& seq,
                const std::vector<std::int64_t>& device_us, const std::vector<std::int64_t>& host_ns) {
                 return unix_times(seq, device_us, host_ns, self);
             })
        .def_prop_ro("rate_hz", [](const fltea::Timebase& self) { return known(self.rate_hz()); })
        .def_prop_ro("clock_ppm", [](const fltea::Timebase& self) { return known(self.clock_ppm()); });
}
