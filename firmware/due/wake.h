// Sleeps until something happens, without missing what happens just before.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace wake {

// Call this from interrupt handlers: there is work for the main loop.
void signal();

// Number of signals since boot; wraps.
uint32_t signals();

// Sleeps until the next interrupt, unless a signal has come since `seen` was read.
void sleep_unless_signalled(uint32_t seen);

}  // namespace wake
}  // namespace due
}  // namespace fltea
