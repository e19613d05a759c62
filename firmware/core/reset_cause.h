// Why the microcontroller last started.
#pragma once

#include <stdint.h>

#include "messages.h"

namespace fltea {

// From RSTC_SR.RSTTYP (SAM3X data sheet, "RSTC Status Register"): general, backup, watchdog, software, user.
inline ResetCause reset_cause_from_rsttyp(uint32_t rsttyp) {
    return rsttyp <= static_cast<uint32_t>(ResetCause::user) ? static_cast<ResetCause>(rsttyp)
                                                             : ResetCause::unknown;
}

}  // namespace fltea
