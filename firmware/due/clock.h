// The chip's clocks: 84 MHz from the 12 MHz crystal.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace clock {

constexpr uint32_t kMasterHz = 84000000;

// Switches from the 4 MHz RC oscillator, with which the chip starts, to the crystal. This runs before .data
// and .bss are set up, so it must not use variables. If the crystal does not start, this waits until the
// watchdog, which already runs, resets the chip.
void start();

// Enables the clock of the peripheral with this number (sam3x::..._IRQ).
void enable(uint32_t peripheral);

}  // namespace clock
}  // namespace due
}  // namespace fltea
