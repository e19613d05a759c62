// Registers as types: the compiler rejects reading a write-only register and writing a read-only one. All
// functions are always inline, because code that runs from RAM must not call into flash.
#pragma once

#include <stdint.h>

namespace sam3x {

template <uint32_t kAddress>
struct ReadOnly {
    [[gnu::always_inline]] static uint32_t read() {
        return *reinterpret_cast<const volatile uint32_t*>(kAddress);
    }
};

template <uint32_t kAddress>
struct WriteOnly {
    [[gnu::always_inline]] static void write(uint32_t value) {
        *reinterpret_cast<volatile uint32_t*>(kAddress) = value;
    }
};

template <uint32_t kAddress>
struct ReadWrite : ReadOnly<kAddress>, WriteOnly<kAddress> {};

// A field of a register: a number of kWidth bits, beginning at bit kLsb.
template <uint32_t kLsb, uint32_t kWidth>
struct Field {
    static constexpr uint32_t kMask = ((1u << kWidth) - 1) << kLsb;

    // Returns a number shifted to the field's bits. Bits beyond the field are cut off.
    static constexpr uint32_t put(uint32_t value) { return value << kLsb & kMask; }
    static constexpr uint32_t of(uint32_t register_value) { return (register_value & kMask) >> kLsb; }
};

}  // namespace sam3x
