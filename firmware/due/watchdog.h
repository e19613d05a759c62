// The watchdog: on from reset to the end, fed by the main loop alone.
#pragma once

namespace fltea {
namespace due {
namespace watchdog {

// Before anything that might hang. WDT_MR can be written once after a reset (datasheet, Watchdog Timer).
void start();

void feed();

}  // namespace watchdog
}  // namespace due
}  // namespace fltea
