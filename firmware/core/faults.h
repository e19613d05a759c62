// Sends FAULT frames to the host, each fault code at most once a second. While the serial port is busy,
// faults wait and are not lost.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "link.h"
#include "messages.h"
#include "timers.h"

namespace fltea {

class Faults {
  public:
    // Reports a fault. If the same code was sent less than a second ago, the fault waits. If more faults of
    // that code are reported meanwhile, one FAULT with the newest detail is sent for all.
    void raise(FaultCode code, uint32_t detail) {
        Entry& entry = entries_[static_cast<size_t>(code) - 1];
        entry.detail = detail;
        entry.waiting = true;
    }

    // Sends the faults that are due, as far as the serial port has room. Call this in every step.
    void send(Link& link, uint32_t now_us) {
        for (size_t i = 0; i < kCodes; ++i) {
            Entry& entry = entries_[i];
            if (!entry.rest.over(now_us) || !entry.waiting) continue;
            if (!link.send(Fault{static_cast<FaultCode>(i + 1), entry.detail}, now_us)) continue;
            entry.waiting = false;
            entry.rest.begin(now_us, kSecondUs);
        }
    }

    // Drops the faults that wait because their code was sent less than a second ago. Call this when the
    // sensor runs again, because the waiting faults are outdated then.
    void forget_repeats() {
        for (Entry& entry : entries_) {
            if (entry.rest.waiting()) entry.waiting = false;
        }
    }

  private:
    static constexpr size_t kCodes = static_cast<size_t>(FaultCode::sensor_frozen);

    struct Entry {
        uint32_t detail = 0;
        Pause rest;
        bool waiting = false;
    };
    Entry entries_[kCodes];
};

}  // namespace fltea
