// Adds the wire protocol to the native module: the decoder, the port reader, and the printer of wire lines.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
void bind_port_reader(nanobind::module_& m);
void bind_port_decoder(nanobind::module_& m);
