// FLTEA_INSTRUCTION_SET as a string and as part of names. It distinguishes code that is compiled once per
// instruction set.
#pragma once

#include "instruction_set.hpp"

#define FLTEA_STRING_(name) #name
#define FLTEA_STRING(name) FLTEA_STRING_(name)
#define FLTEA_JOIN_(a, b) a##b
#define FLTEA_JOIN(a, b) FLTEA_JOIN_(a, b)
