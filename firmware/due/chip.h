// What the microcontroller knows of itself.
#pragma once

#include <stdint.h>

namespace fltea {
namespace due {
namespace chip {

// The identifier of 128 bits that the factory gave it, in the order of memory; zeros if the flash controller
// does not answer.
void read_unique_id(uint8_t (&id)[16]);

// From the true random number generator; 0 if it does not answer.
uint32_t random_number();

// RSTC_SR.RSTTYP.
uint32_t reset_type();

}  // namespace chip
}  // namespace due
}  // namespace fltea
