// Why the microcontroller was last reset.
#pragma once

#include <stdint.h>

#include "messages.h"

namespace fltea {

// Returns the cause for a value of the field RSTC_SR.RSTTYP, which means general, backup, watchdog, software
// or user reset (SAM3X data sheet, "RSTC Status Register").
inline ResetCause reset_cause_from_rsttyp(uint32_t rsttyp) {
    return rsttyp <= static_cast<uint32_t>(ResetCause::user) ? static_cast<ResetCause>(rsttyp)
                                                             : ResetCause::unknown;
}

}  // namespace fltea
