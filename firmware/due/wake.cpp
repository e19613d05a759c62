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

// Interrupts are disabled from the check to the instruction WFI, with which the processor sleeps. If an
// interrupt comes between the two, it stays pending, and WFI ends at once. With interrupts enabled, it would
// be handled before WFI, and the processor would sleep until the next interrupt.
void sleep_unless_signalled(uint32_t seen) {
    cortex_m3::InterruptLock lock;
    if (count == seen) cortex_m3::wait_for_interrupt();
}

}  // namespace wake
}  // namespace due
}  // namespace fltea
