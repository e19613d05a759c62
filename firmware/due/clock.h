// The chip's clocks: 84 MHz from the 12 MHz crystal.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace clock {

constexpr uint32_t kMasterHz = 84000000;

// Leaves the RC oscillator of 4 MHz that the chip starts with. Runs before .data and .bss are set up. A wait
// that does not end (a crystal that does not start) is ended by the watchdog, which runs already.
void start();

// Feeds a peripheral, by its number (sam3x::..._IRQ).
void enable(uint32_t peripheral);

}  // namespace clock
}  // namespace due
}  // namespace fltea
