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

// Created when setup() first calls this: before main() the identity of the board cannot be read.
fltea::Application& device() {
    static fltea::Application application(bus, sink, board_clock, fltea::read_identity());
    return application;
}

void on_data_ready() { device().on_data_ready(micros()); }

// The core calls this before setup(). Without it the core disables the watchdog permanently.
void watchdogSetup() { watchdogEnable(kWatchdogMs); }

void setup() {
    Serial.begin(fltea::settings::kLineBaud);
    bus.recover();
    device().start();
    pinMode(kDataReadyPin, INPUT_PULLUP);  // a disconnected wire must not float; the core disables pull-ups
    if (fltea::settings::kSamplingMode == fltea::SamplingMode::data_ready)
        attachInterrupt(kDataReadyPin, on_data_ready, RISING);
}

void loop() {
    device().step();
    watchdogReset();
}
