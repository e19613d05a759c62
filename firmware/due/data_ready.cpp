#include "data_ready.h"

#include "clock.h"
#include "cortex_m3.h"
#include "handlers.h"
#include "sam3x.h"
#include "wake.h"

namespace fltea {
namespace due {

namespace {

using namespace sam3x;

constexpr uint32_t kPin = 1u << 25;

Application* listener;
Clock* time;

}  // namespace

// The settings in this function come from the SAM3X datasheet, PIO, Input Edge/Level Interrupt.
void data_ready::start(Application& application, Clock& clock) {
    listener = &application;
    time = &clock;
    clock::enable(PIOB_IRQ);
    PIOB_PER::write(kPin);
    PIOB_AIMER::write(kPin);
    PIOB_ESR::write(kPin);
    PIOB_REHLSR::write(kPin);
    PIOB_ISR::read();  // reading this register clears edges that came earlier
    PIOB_IER::write(kPin);
    cortex_m3::enable_irq(PIOB_IRQ);
}

void on_data_ready_pin() {
    const uint32_t now_us = time->now_us();
    if (PIOB_ISR::read() & kPin) listener->on_data_ready(now_us);
    wake::signal();
}

}  // namespace due
}  // namespace fltea
