// setup() calls these functions once. They read what identifies the board and its boot. The registers are
// described in the SAM3X data sheet (11057): TRNG; EEFC, "Unique Identifier"; RSTC_SR.
#pragma once

#include <Arduino.h>
#include <application.h>
#include <string.h>

namespace fltea {

// Largest number of passes of a loop that waits for the chip. This number is more than enough, because the
// random word is ready after 84 clock cycles, and the identifier after some microseconds.
constexpr uint32_t kIdentityTries = 100000;

// Returns a random number, which differs from boot to boot, or 0 if the chip's random generator does not
// answer.
inline uint32_t random_word() {
    pmc_enable_periph_clk(ID_TRNG);
    TRNG->TRNG_CR = TRNG_CR_KEY(0x524E47) | TRNG_CR_ENABLE;
    uint32_t word = 0;
    for (uint32_t i = 0; i < kIdentityTries; ++i) {
        if ((TRNG->TRNG_ISR & TRNG_ISR_DATRDY) != 0) {
            word = TRNG->TRNG_ODATA;
            break;
        }
    }
    TRNG->TRNG_CR = TRNG_CR_KEY(0x524E47);
    pmc_disable_periph_clk(ID_TRNG);
    return word;
}

// Waits until the flag FRDY of the flash controller has the value `wanted`. Returns false if that takes too
// long. Like its caller, this function runs from RAM.
__attribute__((section(".ramfunc"), noinline)) static bool flash_ready_is(bool wanted) {
    for (uint32_t i = 0; i < kIdentityTries; ++i) {
        if (((EFC0->EEFC_FSR & EEFC_FSR_FRDY) != 0) == wanted) return true;
    }
    return false;
}

// Reads the chip's identifier of 128 bits. `id` stays unchanged if the flash controller does not answer.
// During the reading, the first flash bank shows the identifier in place of the program. This function
// therefore runs from RAM and with interrupts disabled.
__attribute__((section(".ramfunc"), noinline)) static void read_unique_identifier(uint32_t (&id)[4]) {
    constexpr uint32_t kKey = 0x5A000000, kStart = 0x0E, kStop = 0x0F;
    const uint32_t mode = EFC0->EEFC_FMR;
    // without the bit SCOD of EEFC_FMR, the identifier may be read wrongly (SAM3X data sheet, Errata)
    EFC0->EEFC_FMR = mode | EEFC_FMR_SCOD;
    EFC0->EEFC_FCR = kKey | kStart;
    if (flash_ready_is(false)) {
        const volatile uint32_t* flash = reinterpret_cast<const volatile uint32_t*>(IFLASH0_ADDR);
        for (int i = 0; i < 4; ++i) id[i] = flash[i];
    }
    EFC0->EEFC_FCR = kKey | kStop;
    flash_ready_is(true);
    EFC0->EEFC_FMR = mode;
}

inline Identity read_identity() {
    Identity identity{};
    identity.boot_id = random_word();
    uint32_t id[4] = {0, 0, 0, 0};
    noInterrupts();
    read_unique_identifier(id);
    interrupts();
    memcpy(identity.device_id, id, sizeof id);
    identity.port = "arduino";
    identity.reset_cause =
        reset_cause_from_rsttyp((RSTC->RSTC_SR & RSTC_SR_RSTTYP_Msk) >> RSTC_SR_RSTTYP_Pos);
    return identity;
}

}  // namespace fltea
