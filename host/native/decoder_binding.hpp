// Functions that add the classes of the wire protocol to the native module: the decoder, the reader of serial
// ports, and the printer of wire messages as text.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
void bind_port_reader(nanobind::module_& m);
void bind_port_decoder(nanobind::module_& m);
