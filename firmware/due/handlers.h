// The interrupt handlers, each defined beside what it serves. All have the same priority: none interrupts
// another one.
#pragma once

namespace fltea {
namespace due {

void on_tick();            // device_clock.cpp
void on_uart();            // uart.cpp
void on_data_ready_pin();  // data_ready.cpp

}  // namespace due
}  // namespace fltea
