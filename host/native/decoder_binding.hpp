// Adds the decoder of the wire to the native module.
#pragma once

#include <nanobind/nanobind.h>

void bind_decoder(nanobind::module_& m);
