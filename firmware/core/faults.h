// FAULTs on their way to the host: each code at most once a second, none lost while the line is full.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "link.h"
#include "messages.h"
#include "timers.h"

namespace fltea {

class Faults {
  public:
    // What comes sooner than a second after the last of its code waits; the newest detail is the one told.
    void raise(FaultCode code, uint32_t detail) {
        Entry& entry = entries_[static_cast<size_t>(code) - 1];
        entry.detail = detail;
        entry.waiting = true;
    }

    // In every step: sends what is due and what the line takes.
    void send(Link& link, uint32_t now_us) {
        for (size_t i = 0; i < kCodes; ++i) {
            Entry& entry = entries_[i];
            if (!entry.rest.over(now_us) || !entry.waiting) continue;
            if (!link.send(Fault{static_cast<FaultCode>(i + 1), entry.detail}, now_us)) continue;
            entry.waiting = false;
            entry.rest.begin(now_us, kSecondUs);
        }
    }

    // The sensor runs: what was told within this second and waits to be told again is history.
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
