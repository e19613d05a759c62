#include "twi.h"

#include "../core/settings.h"
#include "clock.h"
#include "cortex_m3.h"
#include "sam3x.h"

namespace fltea {
namespace due {

namespace {

using namespace sam3x;

constexpr uint32_t kSda = 1u << 12;  // pin PB12, whose peripheral A is TWD1 (SDA)
constexpr uint32_t kScl = 1u << 13;  // pin PB13, whose peripheral A is TWCK1 (SCL)

// In each bit, SCL is low for CLDIV + 4 periods of MCK and high for CHDIV + 4 periods (SAM3X datasheet, TWI
// Clock Waveform Generator Register). SCL is low for longer than it is high, as the fast mode of I2C demands
// (NXP UM10204, table 10).
constexpr uint32_t kFixed = 4;
constexpr uint32_t kBit = clock::kMasterHz / settings::kI2cHz;
constexpr uint32_t kLow = kBit * 54 / 100;
constexpr uint32_t kHigh = kBit - kLow;
constexpr uint32_t kMostHz = 400000, kLeastLowNs = 1300, kLeastHighNs = 600;
static_assert(kLow * 10000 >= kLeastLowNs * (clock::kMasterHz / 100000), "t_LOW");
static_assert(kHigh * 10000 >= kLeastHighNs * (clock::kMasterHz / 100000), "t_HIGH");
static_assert((kLow + kHigh) * kMostHz >= clock::kMasterHz, "f_SCL");
static_assert(kLow - kFixed <= 0xFF && kHigh - kFixed > 0, "CLDIV and CHDIV hold 8 bits without a prescaler");

// Duration of half a bit while the bus is being freed [us]. The clock is then at most 100 kHz.
constexpr uint32_t kHalfBitUs = 5;

void start_controller() {
    TWI1_CR::write(TWI1_CR::SWRST);
    TWI1_RHR::read();
    TWI1_CWGR::write(TWI1_CWGR::CLDIV::put(kLow - kFixed) | TWI1_CWGR::CHDIV::put(kHigh - kFixed));
    TWI1_CR::write(TWI1_CR::MSEN | TWI1_CR::SVDIS);
}

void address(uint8_t chip, uint8_t reg, uint32_t direction) {
    TWI1_MMR::write(TWI1_MMR::DADR::put(chip) | TWI1_MMR::IADRSZ_1_BYTE | direction);
    TWI1_IADR::write(reg);
}

}  // namespace

// SAM3X datasheet, TWI, Read Flowcharts: the controller acknowledges each byte unless STOP was requested
// while the byte arrives. STOP is therefore requested together with START if one byte is read, and otherwise
// when the last byte but one has arrived.
I2cResult Twi::read(uint8_t chip, uint8_t reg, uint8_t* data, size_t n) {
    begun_us_ = clock_.now_us();
    // Drops a byte that the previous read may have left, even if that read was complete: the controller
    // begins to receive another byte while STOP is being sent. Without this, that byte would become the first
    // of the bytes to be read now, and all bytes would be shifted.
    TWI1_RHR::read();
    address(chip, reg, TWI1_MMR::MREAD);
    TWI1_CR::write(n == 1 ? TWI1_CR::START | TWI1_CR::STOP : TWI1_CR::START);
    return finish(receive(data, n));
}

I2cResult Twi::receive(uint8_t* data, size_t n) {
    for (size_t i = 0; i < n; ++i) {
        const I2cResult result = wait_for(TWI1_SR::RXRDY);
        if (result != I2cResult::ok) return result;
        // If the register RHR (received byte) is read late, the controller holds SCL until it is read. After
        // that, only half a bit remains for requesting STOP, so interrupts are disabled.
        cortex_m3::InterruptLock lock;
        data[i] = static_cast<uint8_t>(TWI1_RHR::read());
        if (i + 2 == n) TWI1_CR::write(TWI1_CR::STOP);
    }
    return I2cResult::ok;
}

// SAM3X datasheet, TWI, Write Flowcharts: writing THR starts the transfer, and requesting STOP at once ends
// it after this byte.
I2cResult Twi::write(uint8_t chip, uint8_t reg, uint8_t value) {
    begun_us_ = clock_.now_us();
    address(chip, reg, 0);
    TWI1_THR::write(value);
    TWI1_CR::write(TWI1_CR::STOP);
    // TWI_SR shows the end of this transfer only after the register THR (byte to send) has become empty.
    return finish(wait_for(TWI1_SR::TXRDY));
}

// Waits for a flag of the status register TWI_SR. Reading TWI_SR clears the error flags NACK, ARBLST and
// OVRE, so these flags are checked after every read.
I2cResult Twi::wait_for(uint32_t flag) {
    for (;;) {
        const bool late = clock_.now_us() - begun_us_ > settings::kI2cTimeoutUs;
        const uint32_t status = TWI1_SR::read();
        if (status & TWI1_SR::NACK) return I2cResult::nack;
        // Arbitration was lost. There is no other master, so something pulls SDA low.
        if (status & TWI1_SR::ARBLST) return I2cResult::timeout;
        if (status & TWI1_SR::OVRE) return I2cResult::short_read;
        if (status & flag) return I2cResult::ok;
        if (late) return I2cResult::timeout;
    }
}

// Waits until STOP is sent. After an error, the controller is set up again, because its register THR and its
// flags may still contain old values.
I2cResult Twi::finish(I2cResult result) {
    const I2cResult end = wait_for(TWI1_SR::TXCOMP);
    if (result == I2cResult::ok) result = end;
    if (result != I2cResult::ok) start_controller();
    return result;
}

void Twi::pause() {
    const uint32_t begun_us = clock_.now_us();
    while (clock_.now_us() - begun_us <= kHalfBitUs) {
    }
}

HeldLines Twi::recover() {
    clock::enable(PIOB_IRQ);
    clock::enable(TWI1_IRQ);
    // Sets both lines of the bus to open drain and releases them. Call this before the pins change to another
    // peripheral.
    PIOB_SODR::write(kSda | kScl);
    PIOB_MDER::write(kSda | kScl);
    PIOB_OER::write(kSda | kScl);
    PIOB_PER::write(kSda | kScl);
    pause();

    for (int clocks = 0; clocks < 9 && !(PIOB_PDSR::read() & kSda); ++clocks) {
        PIOB_CODR::write(kScl);
        pause();
        PIOB_SODR::write(kScl);
        pause();
    }
    // A STOP condition: SDA rises while SCL is high.
    PIOB_CODR::write(kScl);
    pause();
    PIOB_CODR::write(kSda);
    pause();
    PIOB_SODR::write(kScl);
    pause();
    PIOB_SODR::write(kSda);
    pause();
    const uint32_t lines = PIOB_PDSR::read();

    PIOB_ABSR::write(PIOB_ABSR::read() & ~(kSda | kScl));
    PIOB_PDR::write(kSda | kScl);
    // The TWI itself drives its pins as open drain (SAM3X datasheet, TWI, I/O Lines).
    PIOB_MDDR::write(kSda | kScl);
    start_controller();

    const bool sda_held = !(lines & kSda);
    const bool scl_held = !(lines & kScl);
    if (sda_held) return scl_held ? HeldLines::both : HeldLines::sda;
    return scl_held ? HeldLines::scl : HeldLines::none;
}

}  // namespace due
}  // namespace fltea
