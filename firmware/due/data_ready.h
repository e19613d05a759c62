// The sensor's INT pin on PB25 (pin 2), for the data_ready mode.
#pragma once

#include "../core/application.h"

namespace fltea {
namespace due {
namespace data_ready {

// From now on the interrupt handler notifies the application of every rising edge.
void start(Application& application, Clock& clock);

}  // namespace data_ready
}  // namespace due
}  // namespace fltea
