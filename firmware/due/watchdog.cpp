#include "watchdog.h"

#include "sam3x.h"

namespace fltea {
namespace due {
namespace watchdog {

namespace {

// Counts at SLCK/128 = 256 Hz: 1 s nominally, 0.7 to 1.6 s with the tolerance of the slow RC oscillator.
constexpr uint32_t kTimeout = 256;
constexpr uint32_t kFeedAtAnyTime = 0xFFF;
constexpr uint32_t kKey = 0xA5;

}  // namespace

void start() {
    using sam3x::WDT_MR;
    // With the largest WDD, feeding is never too early. The watchdog also counts in WFI (no WDIDLEHLT), so
    // that an interrupt that no longer comes is detected too.
    WDT_MR::write(WDT_MR::WDV::put(kTimeout) | WDT_MR::WDD::put(kFeedAtAnyTime) | WDT_MR::WDRSTEN |
                  WDT_MR::WDDBGHLT);
}

void feed() { sam3x::WDT_CR::write(sam3x::WDT_CR::KEY::put(kKey) | sam3x::WDT_CR::WDRSTT); }

}  // namespace watchdog
}  // namespace due
}  // namespace fltea
