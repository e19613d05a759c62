#include "clock.h"

#include "sam3x.h"

namespace fltea {
namespace due {
namespace clock {

namespace {

using namespace sam3x;

constexpr uint32_t kCrystalHz = 12000000;
constexpr uint32_t kMultiplier = 14;
static_assert(kCrystalHz * kMultiplier / 2 == kMasterHz,
              "PLLA, halved by the prescaler, is the master clock");

// Flash wait states needed at 84 MHz (SAM3X datasheet, Electrical Characteristics, Embedded Flash
// Characteristics).
constexpr uint32_t kFlashWaitStates = 4;
constexpr uint32_t kOscillatorKey = 0x37;
// Start-up time of the crystal, in units of 8 periods of the slow clock (32 kHz): 2 ms.
constexpr uint32_t kCrystalStart = 8;
// Longest time for the PLL to lock, in periods of the slow clock: 1.9 ms.
constexpr uint32_t kPllLock = 0x3F;

void wait_for(uint32_t flag) {
    while (!(PMC_SR::read() & flag)) {
    }
}

}  // namespace

// The steps in this function are in the order that the SAM3X datasheet demands (Power Management Controller,
// Programming Sequence).
void start() {
    EFC0_FMR::write(EFC0_FMR::FWS::put(kFlashWaitStates));
    EFC1_FMR::write(EFC1_FMR::FWS::put(kFlashWaitStates));

    const uint32_t oscillators = PMC_CKGR_MOR::KEY::put(kOscillatorKey) | PMC_CKGR_MOR::MOSCRCEN |
                                 PMC_CKGR_MOR::MOSCXTEN | PMC_CKGR_MOR::MOSCXTST::put(kCrystalStart);
    PMC_CKGR_MOR::write(oscillators);
    wait_for(PMC_SR::MOSCXTS);
    PMC_CKGR_MOR::write(oscillators | PMC_CKGR_MOR::MOSCSEL);
    wait_for(PMC_SR::MOSCSELS);
    PMC_MCKR::write(PMC_MCKR::CSS_MAIN_CLK);
    wait_for(PMC_SR::MCKRDY);

    PMC_CKGR_PLLAR::write(PMC_CKGR_PLLAR::ONE | PMC_CKGR_PLLAR::MULA::put(kMultiplier - 1) |
                          PMC_CKGR_PLLAR::PLLACOUNT::put(kPllLock) | PMC_CKGR_PLLAR::DIVA::put(1));
    wait_for(PMC_SR::LOCKA);
    // The prescaler (a division by 2) is set before the PLL becomes the source, so that the clock never runs
    // at 168 MHz.
    PMC_MCKR::write(PMC_MCKR::PRES_CLK_2 | PMC_MCKR::CSS_MAIN_CLK);
    wait_for(PMC_SR::MCKRDY);
    PMC_MCKR::write(PMC_MCKR::PRES_CLK_2 | PMC_MCKR::CSS_PLLA_CLK);
    wait_for(PMC_SR::MCKRDY);
}

void enable(uint32_t peripheral) {
    if (peripheral < 32) {
        PMC_PCER0::write(1u << peripheral);
    } else {
        PMC_PCER1::write(1u << (peripheral - 32));
    }
}

}  // namespace clock
}  // namespace due
}  // namespace fltea
