// Adds the decoder of the wire, and the reader of ports, to the native module.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
void bind_port_reader(nanobind::module_& m);
