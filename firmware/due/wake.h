// Lets the processor sleep until an interrupt, without missing an interrupt that comes just before.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace wake {

// Notes that there is work for the main loop. Interrupt handlers call this.
void signal();

// Number of calls of signal() since boot; it wraps.
uint32_t signals();

// Sleeps until the next interrupt, unless signal() was called since `seen` was read with signals().
void sleep_unless_signalled(uint32_t seen);

}  // namespace wake
}  // namespace due
}  // namespace fltea
