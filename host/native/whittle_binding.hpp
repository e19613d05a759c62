#pragma once
#include <nanobind/nanobind.h>

void bind_whittle_fits(nanobind::module_& m);
