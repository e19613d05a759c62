// The input for the sensor's INT pin, PB25 (pin 2 of the board), in the data_ready mode.
#pragma once

#include "../core/application.h"

namespace fltea {
namespace due {
namespace data_ready {

// Enables the interrupt of the pin. From now on, its handler notifies the application of every rising edge.
void start(Application& application, Clock& clock);

}  // namespace data_ready
}  // namespace due
}  // namespace fltea
