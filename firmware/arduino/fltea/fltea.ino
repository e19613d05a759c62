// fltea's device on an Arduino Due. firmware/README.md describes wiring, settings and how to flash it.
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

// Created at the first call, in setup(), because the board's identity cannot be read before main().
fltea::Application& device() {
    static fltea::Application application(bus, sink, board_clock, fltea::read_identity());
    return application;
}

void on_data_ready() { device().on_data_ready(micros()); }

// The Arduino core calls this before setup(). Without this function it disables the watchdog permanently.
void watchdogSetup() { watchdogEnable(kWatchdogMs); }

void setup() {
    Serial.begin(fltea::settings::kLineBaud);
    bus.recover();
    device().start();
    pinMode(kDataReadyPin, INPUT_PULLUP);  // a pin to which nothing is connected must not float
    if (fltea::settings::kSamplingMode == fltea::SamplingMode::data_ready)
        attachInterrupt(kDataReadyPin, on_data_ready, RISING);
}

void loop() {
    device().step();
    watchdogReset();
}
