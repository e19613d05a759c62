// fltea's device on an Arduino Due (firmware/README.md: wiring, settings, how to flash).
#include <Wire.h>
#include <application.h>

#include "identity.h"
#include "micros_clock.h"
#include "serial_sink.h"
#include "wire_bus.h"

constexpr uint32_t kDataReadyPin = 2;
constexpr uint32_t kWatchdogMs = 2000;

fltea::WireBus bus(Wire);
fltea::SerialSink sink(Serial);
fltea::MicrosClock board_clock;

// Made when setup() first asks: before main() the board is not up, and its identity cannot be read.
fltea::Application& device() {
    static fltea::Application application(bus, sink, board_clock, fltea::read_identity());
    return application;
}

void on_data_ready() { device().on_data_ready(micros()); }

// Called by the core before setup(); without it the core switches the watchdog off for good.
void watchdogSetup() { watchdogEnable(kWatchdogMs); }

void setup() {
    Serial.begin(fltea::settings::kLineBaud);
    bus.recover();
    device().start();
    pinMode(kDataReadyPin, INPUT_PULLUP);  // a broken wire must not float: the core switches pull-ups off
    if (fltea::settings::kSamplingMode == fltea::SamplingMode::data_ready)
        attachInterrupt(kDataReadyPin, on_data_ready, RISING);
}

void loop() {
    device().step();
    watchdogReset();
}
