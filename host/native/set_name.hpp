// FLTEA_INSTRUCTION_SET as text, and as a part of names: what is compiled once for each set is told apart by
// it.
#pragma once

#include "instruction_set.hpp"

#define FLTEA_STRING_(name) #name
#define FLTEA_STRING(name) FLTEA_STRING_(name)
#define FLTEA_JOIN_(a, b) a##b
#define FLTEA_JOIN(a, b) FLTEA_JOIN_(a, b)
