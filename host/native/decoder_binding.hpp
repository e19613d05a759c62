// Functions that add three classes to the native module fltea._native: the decoder of the wire protocol, the
// reader of serial ports, and the decoder that turns what came from such a port into items.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
void bind_port_reader(nanobind::module_& m);
void bind_port_decoder(nanobind::module_& m);
