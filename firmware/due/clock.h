// The chip's clocks: 84 MHz from the 12 MHz crystal.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace clock {

constexpr uint32_t kMasterHz = 84000000;

// Switches from the 4 MHz RC oscillator, with which the chip starts, to the crystal. Runs before .data and
// .bss are set up. If the crystal does not start, the wait does not end and the watchdog, which already runs,
// resets the chip.
void start();

// Enables the clock of a peripheral, by its number (sam3x::..._IRQ).
void enable(uint32_t peripheral);

}  // namespace clock
}  // namespace due
}  // namespace fltea
