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

// Interrupts are disabled between the question and WFI, and a pending one ends WFI all the same: a tick just
// before WFI would otherwise be slept through until the next one.
void sleep_unless_signalled(uint32_t seen) {
    cortex_m3::InterruptLock lock;
    if (count == seen) cortex_m3::wait_for_interrupt();
}

}  // namespace wake
}  // namespace due
}  // namespace fltea
