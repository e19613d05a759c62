#include "device_clock.h"

#include "../core/settings.h"
#include "clock.h"
#include "cortex_m3.h"
#include "handlers.h"
#include "sam3x.h"
#include "wake.h"

namespace fltea {
namespace due {

namespace {

using namespace sam3x;

constexpr uint32_t kCountsPerUs = clock::kMasterHz / 2 / 1000000;
static_assert(kCountsPerUs * 2 * 1000000 == clock::kMasterHz, "a microsecond is a whole number of counts");
constexpr uint32_t kTickUs = settings::kSamplePeriodUs;
constexpr uint32_t kTickCounts = kTickUs * kCountsPerUs;

// Time and counter value at the last timer interrupt (tick). The counter alone would not give the time: it
// wraps every 2^32 counts (102 s), which is not a whole number of microseconds.
uint32_t tick_us;
uint32_t tick_count;

}  // namespace

// In Waveform Mode (SAM3X datasheet, Timer Counter) the counter counts up to 2^32 - 1 and continues from 0.
// The register RC does not limit the counter. When the counter equals RC, an interrupt comes, and the counter
// goes on.
void DeviceClock::start() {
    clock::enable(TC0_IRQ);
    TC0_CMR0::write(TC0_CMR0::TCCLKS_TIMER_CLOCK1 | TC0_CMR0::WAVE | TC0_CMR0::WAVSEL_UP);
    TC0_RC0::write(kTickCounts);
    TC0_IER0::write(TC0_IER0::CPCS);
    TC0_CCR0::write(TC0_CCR0::CLKEN | TC0_CCR0::SWTRG);
    cortex_m3::enable_irq(TC0_IRQ);
}

uint32_t DeviceClock::now_us() {
    cortex_m3::InterruptLock lock;
    return tick_us + (TC0_CV0::read() - tick_count) / kCountsPerUs;
}

void on_tick() {
    TC0_SR0::read();  // reading this register clears the interrupt request
    // The counter value of the next interrupt is set first, and the counter is read afterwards. If the
    // counter has passed that value meanwhile, the loop handles this tick as well, so no tick is missed.
    while (TC0_CV0::read() - tick_count >= kTickCounts) {
        tick_count += kTickCounts;
        tick_us += kTickUs;
        TC0_RC0::write(tick_count + kTickCounts);
    }
    wake::signal();
}

}  // namespace due
}  // namespace fltea
