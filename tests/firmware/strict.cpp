// Compiled with the firmware's flags only, never run: every template that the firmware uses compiles without
// exceptions and RTTI.
#include "cobs.h"
#include "crc32.h"
#include "frame.h"
#include "messages.h"

size_t hello(const fltea::Hello& message, uint8_t* out) { return fltea::encode_message(message, 1, 2, out); }
size_t sample(const fltea::Sample& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t status(const fltea::Status& message, uint8_t* out) {
    return fltea::encode_message(message, 1, 2, out);
}
size_t fault(const fltea::Fault& message, uint8_t* out) { return fltea::encode_message(message, 1, 2, out); }
size_t raw(const uint8_t* payload, size_t n, uint8_t* out) {
    return fltea::encode_frame(9, 1, 2, payload, n, out) + fltea::cobs_encode(payload, n, out);
}
uint32_t crc(const uint8_t* data, size_t n) { return fltea::crc32(data, n); }
uint8_t flags() { return fltea::sample_flags::late; }
