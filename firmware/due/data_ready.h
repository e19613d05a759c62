// The sensor's INT pin on PB25 (pin 2), for the data_ready mode.
#pragma once

#include "../core/application.h"

namespace fltea {
namespace due {
namespace data_ready {

// From now on every rising edge is told to the application, from the interrupt handler.
void start(Application& application, Clock& clock);

}  // namespace data_ready
}  // namespace due
}  // namespace fltea
