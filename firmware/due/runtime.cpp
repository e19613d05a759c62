// Functions that the compiler calls implicitly. There is no C library here.
#include <stddef.h>
#include <stdint.h>

extern "C" {

void* memcpy(void* to, const void* from, size_t n) {
    uint8_t* out = static_cast<uint8_t*>(to);
    const uint8_t* in = static_cast<const uint8_t*>(from);
    for (size_t i = 0; i < n; ++i) out[i] = in[i];
    return to;
}

void* memmove(void* to, const void* from, size_t n) {
    uint8_t* out = static_cast<uint8_t*>(to);
    const uint8_t* in = static_cast<const uint8_t*>(from);
    if (out <= in) return memcpy(to, from, n);
    while (n-- > 0) out[n] = in[n];
    return to;
}

void* memset(void* to, int value, size_t n) {
    uint8_t* out = static_cast<uint8_t*>(to);
    for (size_t i = 0; i < n; ++i) out[i] = static_cast<uint8_t>(value);
    return to;
}

int memcmp(const void* left, const void* right, size_t n) {
    const uint8_t* a = static_cast<const uint8_t*>(left);
    const uint8_t* b = static_cast<const uint8_t*>(right);
    for (size_t i = 0; i < n; ++i) {
        if (a[i] != b[i]) return a[i] - b[i];
    }
    return 0;
}

// The compiler puts this function into the vtables of abstract classes, in place of pure virtual functions.
// It is never called.
[[noreturn]] void unexpected_handler();
[[noreturn]] void __cxa_pure_virtual() { unexpected_handler(); }

}  // extern "C"
