#include "wake.h"

#include "cortex_m3.h"

namespace fltea {
namespace due {
namespace wake {

namespace {

volatile uint32_t count;

}  // namespace

void signal() { count = count + 1; }

uint32_t signals() { return count; }

// Interrupts are disabled between the check and the instruction WFI. A pending interrupt ends WFI
// nevertheless. If interrupts were enabled, a tick between the check and WFI would be handled before the
// processor sleeps, and the processor would sleep until the next tick.
void sleep_unless_signalled(uint32_t seen) {
    cortex_m3::InterruptLock lock;
    if (count == seen) cortex_m3::wait_for_interrupt();
}

}  // namespace wake
}  // namespace due
}  // namespace fltea
