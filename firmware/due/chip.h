// Information about the microcontroller.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace chip {

// Reads the factory's 128-bit identifier of the chip, in the order of its bytes in memory. If the flash
// controller does not answer, the identifier is all zeros.
void read_unique_id(uint8_t (&id)[16]);

// Returns a number from the true random number generator, or 0 if the generator does not answer.
uint32_t random_number();

// Returns the cause of the last reset, which is the field RSTC_SR.RSTTYP.
uint32_t reset_type();

}  // namespace chip
}  // namespace due
}  // namespace fltea
