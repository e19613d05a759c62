// The part of Atmel's CMSIS headers for the SAM3X8E that the sketch uses. It also has those macros of the
// headers whose names would break fltea's core if the core used them.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace stub {

// A register: reading and writing it calls functions of the simulated board.
template <uint32_t (*Read)(), void (*Write)(uint32_t)>
struct Register {
    operator uint32_t() const { return Read(); }
    Register& operator=(uint32_t value) {
        Write(value);
        return *this;
    }
};

uint32_t read_nothing();
void write_nothing(uint32_t);
void trng_control(uint32_t);
uint32_t trng_status();
uint32_t trng_data();
uint32_t flash_mode();
void flash_set_mode(uint32_t);
void flash_command(uint32_t);
uint32_t flash_status();
uint32_t reset_status();
uint32_t received_byte();
uintptr_t flash_address();

}  // namespace stub

struct Trng {
    stub::Register<stub::read_nothing, stub::trng_control> TRNG_CR;
    stub::Register<stub::trng_status, stub::write_nothing> TRNG_ISR;
    stub::Register<stub::trng_data, stub::write_nothing> TRNG_ODATA;
};
struct Efc {
    stub::Register<stub::flash_mode, stub::flash_set_mode> EEFC_FMR;
    stub::Register<stub::read_nothing, stub::flash_command> EEFC_FCR;
    stub::Register<stub::flash_status, stub::write_nothing> EEFC_FSR;
};
struct Rstc {
    stub::Register<stub::reset_status, stub::write_nothing> RSTC_SR;
};
struct Twi {
    stub::Register<stub::received_byte, stub::write_nothing> TWI_RHR;
};

extern Trng stub_trng;
extern Efc stub_efc0;
extern Rstc stub_rstc;
extern Twi stub_twi1;
#define TRNG (&stub_trng)
#define EFC0 (&stub_efc0)
#define RSTC (&stub_rstc)
#define TWI1 (&stub_twi1)

#define TRNG_CR_ENABLE (0x1u << 0)
#define TRNG_CR_KEY(value) ((0xffffffu << 8) & ((value) << 8))
#define TRNG_ISR_DATRDY (0x1u << 0)
#define EEFC_FMR_SCOD (0x1u << 16)
#define EEFC_FSR_FRDY (0x1u << 0)
#define RSTC_SR_RSTTYP_Pos 8
#define RSTC_SR_RSTTYP_Msk (0x7u << RSTC_SR_RSTTYP_Pos)
#define IFLASH0_ADDR (stub::flash_address())
#define ID_TRNG (41)

extern "C" {
uint32_t pmc_enable_periph_clk(uint32_t ul_id);
uint32_t pmc_disable_periph_clk(uint32_t ul_id);
}
void __disable_irq();
void __enable_irq();

// In the real headers, each of these names is a macro for a pointer. Here, each is a macro such that any use
// of the name fails to compile.
#define NOT_OURS "this name belongs to CMSIS"
#define MPU NOT_OURS
#define SCB NOT_OURS
#define NVIC NOT_OURS
#define DWT NOT_OURS
#define ITM NOT_OURS
#define TPI NOT_OURS
#define SysTick NOT_OURS
#define CoreDebug NOT_OURS
#define HSMCI NOT_OURS
#define SSC NOT_OURS
#define SPI0 NOT_OURS
#define TC0 NOT_OURS
#define TC1 NOT_OURS
#define TC2 NOT_OURS
#define TWI0 NOT_OURS
#define PWM NOT_OURS
#define USART0 NOT_OURS
#define UOTGHS NOT_OURS
#define EMAC NOT_OURS
#define CAN0 NOT_OURS
#define ADC NOT_OURS
#define DACC NOT_OURS
#define DMAC NOT_OURS
#define SMC NOT_OURS
#define MATRIX NOT_OURS
#define PMC NOT_OURS
#define UART NOT_OURS
#define CHIPID NOT_OURS
#define EFC1 NOT_OURS
#define PIOA NOT_OURS
#define PIOB NOT_OURS
#define PIOC NOT_OURS
#define PIOD NOT_OURS
#define SUPC NOT_OURS
#define RTT NOT_OURS
#define WDT NOT_OURS
#define RTC NOT_OURS
#define GPBR NOT_OURS
