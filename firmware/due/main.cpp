// The program for the Due. It sets up the board, and then does three things in turn: it calls the
// application's step(), feeds the watchdog, and sleeps.
#include "../core/application.h"
#include "chip.h"
#include "data_ready.h"
#include "device_clock.h"
#include "led.h"
#include "twi.h"
#include "uart.h"
#include "wake.h"
#include "watchdog.h"

int main() {
    using namespace fltea;
    using namespace fltea::due;

    Identity identity;
    identity.boot_id = chip::random_number();
    chip::read_unique_id(identity.device_id);
    identity.port = "due";
    identity.reset_cause = reset_cause_from_rsttyp(chip::reset_type());

    led::start();
    static DeviceClock time;
    time.start();
    static Uart uart;
    uart.start();
    static Twi twi(time);
    twi.recover();

    static Application application(twi, uart, time, identity);
    application.start();
    if (settings::kSamplingMode == SamplingMode::data_ready) data_ready::start(application, time);

    for (;;) {
        const uint32_t seen = wake::signals();
        const bool more = application.step();
        watchdog::feed();
        led::show(time.now_us());
        if (!more) wake::sleep_unless_signalled(seen);
    }
}
