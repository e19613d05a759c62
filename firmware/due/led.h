// The board's LED (PB27, pin 13), which blinks about once a second while the main loop runs.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace led {

void start();
void show(uint32_t now_us);

}  // namespace led
}  // namespace due
}  // namespace fltea
