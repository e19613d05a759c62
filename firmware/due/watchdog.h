// The watchdog: runs from reset on, and only the main loop feeds it.
#pragma once

namespace fltea {
namespace due {
namespace watchdog {

// Call this before anything that might hang. WDT_MR can be written once after a reset (datasheet, Watchdog
// Timer).
void start();

void feed();

}  // namespace watchdog
}  // namespace due
}  // namespace fltea
