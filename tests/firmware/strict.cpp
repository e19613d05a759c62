// This file is only compiled, with the flags of the firmware, and never run. It shows that every template
// that the firmware uses compiles without exceptions and RTTI, and that no object of the core is too large
// for a small chip.
#include "application.h"

size_t hello(const fltea::Hello& message, uint8_t* out) { return fltea::encode_message(message, 1, 2, out); }
size_t sample(const fltea::Sample& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t status(const fltea::Status& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t fault(const fltea::Fault& message, uint8_t* out) { return fltea::encode_message(message, 1, 2, out); }
size_t estimate(const fltea::Estimate& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t estimator(const fltea::Estimator& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t fit(const fltea::Fit& message, uint8_t* out) { return fltea::encode_message(message, 1, 2, out); }
size_t spectrum(const fltea::Spectrum& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t raw(const uint8_t* payload, size_t n, uint8_t* out) {
    return fltea::encode_frame(9, 1, 2, payload, n, out) + fltea::cobs_encode(payload, n, out);
}
uint32_t checksum(const uint8_t* data, size_t n) { return fltea::crc32(data, n); }

void run(fltea::I2cBus& bus, fltea::ByteSink& sink, fltea::Clock& clock, const fltea::Identity& identity) {
    fltea::Application application(bus, sink, clock, identity);
    application.start();
    application.on_data_ready(1);
    application.step();
}
fltea::ResetCause cause(uint32_t rsttyp) { return fltea::reset_cause_from_rsttyp(rsttyp); }
uint32_t line() { return fltea::settings::kLineBaud + fltea::settings::kI2cHz; }

// The limit for the machine that runs the tests, where pointers are twice as long as on the Due, so that an
// Application is larger.
static_assert(sizeof(fltea::Application) <= size_t(45) * 1024, "the core's share of the RAM");
