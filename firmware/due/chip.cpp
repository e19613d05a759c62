#include "chip.h"

#include "clock.h"
#include "cortex_m3.h"
#include "sam3x.h"

namespace fltea {
namespace due {
namespace chip {

namespace {

using namespace sam3x;

constexpr uint32_t kFlash = 0x00080000;
constexpr uint32_t kRandomKey = 0x524E47;
// Largest number of polls of a waiting loop. It is far more than reading the identifier or a random number
// takes.
constexpr uint32_t kPolls = 10000;

// See the SAM3X datasheet, EEFC, Unique Identifier. While the chip is reading its identifier, the identifier
// replaces the first words of the flash, and no code may be fetched from this flash. This function therefore
// runs from RAM, and the caller has disabled interrupts. Setting SCOD is the workaround for an erratum
// (datasheet, Errata, Flash): without SCOD the identifier may not be readable.
[[gnu::section(".ram_code"), gnu::noinline, gnu::long_call]] void read_unique_words(uint32_t (&words)[4]) {
    const uint32_t mode = EFC0_FMR::read();
    EFC0_FMR::write(mode | EFC0_FMR::SCOD);
    EFC0_FCR::write(EFC0_FCR::FKEY_PASSWD | EFC0_FCR::FCMD_STUI);
    uint32_t polls = kPolls;
    while ((EFC0_FSR::read() & EFC0_FSR::FRDY) && polls > 0) --polls;
    if (polls > 0) {
        const volatile uint32_t* source = reinterpret_cast<const volatile uint32_t*>(kFlash);
        for (uint32_t& word : words) word = *source++;
    }
    EFC0_FCR::write(EFC0_FCR::FKEY_PASSWD | EFC0_FCR::FCMD_SPUI);
    // This loop waits without a limit: until the flash shows the program again, there is no code to return
    // to. If the program never comes back, the watchdog resets the chip.
    while (!(EFC0_FSR::read() & EFC0_FSR::FRDY)) {
    }
    EFC0_FMR::write(mode);
}

}  // namespace

void read_unique_id(uint8_t (&id)[16]) {
    uint32_t words[4] = {0, 0, 0, 0};
    {
        cortex_m3::InterruptLock lock;
        read_unique_words(words);
    }
    for (uint32_t i = 0; i < 16; ++i) id[i] = static_cast<uint8_t>(words[i / 4] >> (i % 4 * 8));
}

uint32_t random_number() {
    clock::enable(TRNG_IRQ);
    TRNG_CR::write(TRNG_CR::KEY::put(kRandomKey) | TRNG_CR::ENABLE);
    uint32_t number = 0;
    for (uint32_t polls = kPolls; polls > 0; --polls) {
        if (TRNG_ISR::read() & TRNG_ISR::DATRDY) {
            number = TRNG_ODATA::read();
            break;
        }
    }
    TRNG_CR::write(TRNG_CR::KEY::put(kRandomKey));
    return number;
}

uint32_t reset_type() { return RSTC_SR::RSTTYP::of(RSTC_SR::read()); }

}  // namespace chip
}  // namespace due
}  // namespace fltea
