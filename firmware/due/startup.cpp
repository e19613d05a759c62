// From reset to main(): the vector table, the initialisation of the memory, and the fault handler.
#include <stdint.h>

#include "../core/settings.h"
#include "clock.h"
#include "cortex_m3.h"
#include "handlers.h"
#include "sam3x.h"
#include "watchdog.h"

int main();

// These symbols are defined in the linker script.
extern "C" {
extern uint32_t stack_top[];
extern uint32_t data_begin[];
extern uint32_t data_end[];
extern const uint32_t data_image[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];
}

// Handles an unexpected fault or interrupt, after which the program cannot be trusted any more. The watchdog
// is not fed here, so it resets the chip within a second, and the next HELLO reports that.
extern "C" [[noreturn]] void unexpected_handler() {
    for (;;) asm volatile("");
}

extern "C" [[noreturn]] void reset_handler();

namespace fltea {
namespace due {
namespace {

using Handler = void (*)();

// The layout of the table is defined in the ARMv7-M Architecture Reference Manual, B1.5.3.
struct VectorTable {
    const void* initial_stack;
    Handler reset;
    Handler exceptions[14];  // exceptions 2 (NMI) to 15 (SysTick)
    // the handlers of the peripherals, in the order of the SAM3X datasheet, section 9.1
    Handler interrupts[45];
};

constexpr Handler on(uint32_t irq) {
    return irq == sam3x::TC0_IRQ    ? on_tick
           : irq == sam3x::UART_IRQ ? on_uart
           : irq == sam3x::PIOB_IRQ && settings::kSamplingMode == SamplingMode::data_ready
               ? on_data_ready_pin
               : unexpected_handler;
}

__attribute__((section(".vectors"), used)) constexpr VectorTable kVectors = {
    stack_top,
    reset_handler,
    {unexpected_handler, unexpected_handler, unexpected_handler, unexpected_handler, unexpected_handler,
     unexpected_handler, unexpected_handler, unexpected_handler, unexpected_handler, unexpected_handler,
     unexpected_handler, unexpected_handler, unexpected_handler, unexpected_handler},
    {on(0),  on(1),  on(2),  on(3),  on(4),  on(5),  on(6),  on(7),  on(8),  on(9),  on(10), on(11),
     on(12), on(13), on(14), on(15), on(16), on(17), on(18), on(19), on(20), on(21), on(22), on(23),
     on(24), on(25), on(26), on(27), on(28), on(29), on(30), on(31), on(32), on(33), on(34), on(35),
     on(36), on(37), on(38), on(39), on(40), on(41), on(42), on(43), on(44)},
};

}  // namespace
}  // namespace due
}  // namespace fltea

extern "C" [[noreturn]] void reset_handler() {
    fltea::due::watchdog::start();
    fltea::due::clock::start();
    const uint32_t* image = data_image;
    for (uint32_t* word = data_begin; word != data_end; ++word) *word = *image++;
    for (uint32_t* word = bss_begin; word != bss_end; ++word) *word = 0;
    // After a reset, the processor reads the vector table at address 0, where the chip shows the flash a
    // second time. From here on, the processor reads the table at its own address in the flash.
    cortex_m3::SCB_VTOR::write(static_cast<uint32_t>(reinterpret_cast<uintptr_t>(&fltea::due::kVectors)));
    main();
    unexpected_handler();
}
