// Adds what is read of the wire to the native module: its decoder, the reader of ports, a line.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
void bind_port_reader(nanobind::module_& m);
void bind_wire_line(nanobind::module_& m);
