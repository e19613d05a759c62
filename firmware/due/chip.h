// Information about the microcontroller.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace chip {

// Reads the factory's 128-bit identifier, in memory order; zeros if the flash controller does not answer.
void read_unique_id(uint8_t (&id)[16]);

// Returns a number from the true random number generator; 0 if it does not answer.
uint32_t random_number();

// Returns RSTC_SR.RSTTYP.
uint32_t reset_type();

}  // namespace chip
}  // namespace due
}  // namespace fltea
