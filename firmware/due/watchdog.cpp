#include "watchdog.h"

#include "sam3x.h"

namespace fltea {
namespace due {
namespace watchdog {

namespace {

// The watchdog counts at SLCK/128 = 256 Hz, so this time-out is nominally 1 s. With the tolerance of the slow
// RC oscillator, it is 0.7 to 1.6 s.
constexpr uint32_t kTimeout = 256;
constexpr uint32_t kFeedAtAnyTime = 0xFFF;
constexpr uint32_t kKey = 0xA5;

}  // namespace

void start() {
    using sam3x::WDT_MR;
    // With the largest value of its field WDD, the watchdog may be fed at any time. As WDIDLEHLT is not set,
    // the watchdog also counts while the processor sleeps, so it resets the chip if interrupts no longer
    // come.
    WDT_MR::write(WDT_MR::WDV::put(kTimeout) | WDT_MR::WDD::put(kFeedAtAnyTime) | WDT_MR::WDRSTEN |
                  WDT_MR::WDDBGHLT);
}

void feed() { sam3x::WDT_CR::write(sam3x::WDT_CR::KEY::put(kKey) | sam3x::WDT_CR::WDRSTT); }

}  // namespace watchdog
}  // namespace due
}  // namespace fltea
