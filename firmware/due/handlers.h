// The interrupt handlers. Each is defined in the file of the hardware that it serves. All have the same
// priority, so none interrupts another.
#pragma once

namespace fltea {
namespace due {

void on_tick();            // defined in device_clock.cpp
void on_uart();            // defined in uart.cpp
void on_data_ready_pin();  // defined in data_ready.cpp

}  // namespace due
}  // namespace fltea
