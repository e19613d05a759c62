// Lets the processor sleep until an interrupt, without missing an interrupt that comes just before the
// processor sleeps.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace wake {

// Notes that there is work for the main loop. Interrupt handlers call this.
void signal();

// Returns the number of calls of signal() since the last reset. This number wraps.
uint32_t signals();

// Sleeps until the next interrupt, unless signal() was called since `seen` was read with signals().
void sleep_unless_signalled(uint32_t seen);

}  // namespace wake
}  // namespace due
}  // namespace fltea
