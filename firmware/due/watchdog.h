// The watchdog, which resets the chip unless the main loop feeds it. It runs from reset on.
#pragma once

namespace fltea {
namespace due {
namespace watchdog {

// Starts the watchdog. Call this before anything that might hang, and only once, because WDT_MR can be
// written once after a reset (SAM3X datasheet, Watchdog Timer).
void start();

void feed();

}  // namespace watchdog
}  // namespace due
}  // namespace fltea
