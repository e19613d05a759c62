// Macros that make a string and parts of names from FLTEA_INSTRUCTION_SET, the name of the instruction set.
// Such names distinguish the copies of code that is compiled once for each instruction set.
#pragma once

#include "instruction_set.hpp"

#define FLTEA_STRING_(name) #name
#define FLTEA_STRING(name) FLTEA_STRING_(name)
#define FLTEA_JOIN_(a, b) a##b
#define FLTEA_JOIN(a, b) FLTEA_JOIN_(a, b)
