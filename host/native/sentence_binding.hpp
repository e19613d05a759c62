#pragma once
#include <nanobind/nanobind.h>

void bind_sentences(nanobind::module_& m);
