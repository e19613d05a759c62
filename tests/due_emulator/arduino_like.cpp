// A program that makes the same register accesses as a sketch on the Arduino core from reset on, without
// using that core. It turns the watchdog off, and sets up the clock, SysTick, every pin, the analogue parts
// and USB. It uses Serial by interrupts and Wire by polling. Then it takes a sample every 10 ms.
#include <stddef.h>
#include <stdint.h>

namespace {

volatile uint32_t& at(uint32_t address) { return *reinterpret_cast<volatile uint32_t*>(address); }

const uint32_t kPmc = 0x400E0600, kEfc0 = 0x400E0A00, kEfc1 = 0x400E0C00, kUart = 0x400E0800,
               kTwi = 0x40090000;
const uint32_t kPio[4] = {0x400E0E00, 0x400E1000, 0x400E1200, 0x400E1400};
const uint32_t kAdc = 0x400C0000, kDacc = 0x400C8000, kPwm = 0x40094000, kUsb = 0x400AC000;
const uint32_t kSysTick = 0xE000E010, kNvic = 0xE000E100, kIcsr = 0xE000ED04, kShcsr = 0xE000ED24;
const uint32_t kSensor = 0x68;

volatile uint32_t tick_ms;

void wait_for(uint32_t address, uint32_t bits) {
    while ((at(address) & bits) == 0) {
    }
}

void set_clocks() {
    at(kEfc0) = 4 << 8;
    at(kEfc1) = 4 << 8;
    const uint32_t key = 0x37 << 16, start = 8 << 8;
    if (!(at(kPmc + 0x20) & 1 << 24)) {
        at(kPmc + 0x20) = key | start | 1 << 3 | 1;
        wait_for(kPmc + 0x68, 1);
    }
    at(kPmc + 0x20) = key | start | 1 << 3 | 1 | 1 << 24;
    wait_for(kPmc + 0x68, 1 << 16);
    at(kPmc + 0x30) = (at(kPmc + 0x30) & ~3u) | 1;
    wait_for(kPmc + 0x68, 1 << 3);
    at(kPmc + 0x28) = 1 << 29 | 13 << 16 | 0x3F << 8 | 1;
    wait_for(kPmc + 0x68, 1 << 1);
    at(kPmc + 0x30) = 1 << 4 | 1;
    wait_for(kPmc + 0x68, 1 << 3);
    at(kPmc + 0x30) = 1 << 4 | 2;
    wait_for(kPmc + 0x68, 1 << 3);
}

void enable_clock(uint32_t id) {
    const uint32_t enable = id < 32 ? 0x10 : 0x100, status = id < 32 ? 0x18 : 0x108;
    if (!(at(kPmc + status) & 1u << id % 32)) at(kPmc + enable) = 1u << id % 32;
}

void start_systick() {
    at(kSysTick + 4) = 84000 - 1;
    *reinterpret_cast<volatile uint8_t*>(0xE000ED23) = 15 << 4;
    at(kSysTick + 8) = 0;
    at(kSysTick) = 7;
}

uint32_t micros() {
    uint32_t ticks, ticks2 = at(kSysTick + 8);
    bool pending, pending2 = at(kIcsr) & 1 << 26 || at(kShcsr) & 1 << 11;
    uint32_t count, count2 = tick_ms;
    do {
        ticks = ticks2;
        pending = pending2;
        count = count2;
        ticks2 = at(kSysTick + 8);
        pending2 = at(kIcsr) & 1 << 26 || at(kShcsr) & 1 << 11;
        count2 = tick_ms;
    } while (pending != pending2 || count != count2 || ticks < ticks2);
    return (count + pending) * 1000 + (at(kSysTick + 4) - ticks) / 84;
}

void delay(uint32_t ms) {
    const uint32_t begun = tick_ms;
    while (tick_ms - begun < ms) {
    }
}

void give_to_peripheral_a(uint32_t pio, uint32_t pins, bool pull_up) {
    at(pio + 0x44) = pins;
    at(pio + 0x70) &= ~pins & at(pio + 0x70);
    at(pio + 0x04) = pins;
    at(pio + (pull_up ? 0x64 : 0x60)) = pins;
}

void set_pins() {
    for (uint32_t pio : kPio) {
        for (uint32_t pin = 0; pin < 32; ++pin) {
            if (at(pio + 0x08) & at(pio + 0x18) & 1u << pin)
                at(pio + 0x34) = 1u << pin;
            else
                at(pio + 0x60) = 1u << pin;
        }
        at(pio + 0xA0) = 0xFFFFFFFF;
    }
    give_to_peripheral_a(kPio[0], 1 << 8 | 1 << 9, false);  // Serial
    at(kPio[0] + 0x64) = 1 << 8;
    give_to_peripheral_a(kPio[0], 1 << 10 | 1 << 11 | 1 << 12 | 1 << 13 | 3, false);
    give_to_peripheral_a(kPio[1], 1 << 10 | 1 << 11 | 1 << 14 | 1 << 15, false);
}

void set_analogue() {
    enable_clock(37);
    at(kAdc) = 1;
    at(kAdc + 4) = 0;
    at(kAdc + 0x120) = 1 << 1 | 1 << 9;
    at(kAdc + 0x104) = 0;
    at(kAdc + 0x114) = 0;
    at(kAdc + 4) |= 2 << 8 | 8 << 16;
    at(kAdc + 4) |= 1 << 28 | 3 << 20;
    at(kAdc + 4) &= ~0xFu;
    at(kAdc + 0x28) = 0xFFFFFFFF;
    at(kAdc + 0x14) = 0xFFFF;
    enable_clock(38);
    at(kDacc) = 1;
    at(kDacc + 4) = 1 << 4 | 8 << 8;
    at(kDacc + 0x14) = 3;
    enable_clock(36);
    at(kPwm) = 84;
    at(kPwm + 0x08) = 1 << 6;
}

void start_usb() {
    at(kPmc + 0x1C) = 3 << 20 | 1 << 16;
    wait_for(kPmc + 0x68, 1 << 6);
    at(kPmc + 0x38) = 1;
    at(kPmc) = 1 << 5;
    enable_clock(40);
    at(kUsb + 0x800) &= ~(1u << 24);
    at(kUsb + 0x800) |= 1 << 25;
    at(kUsb + 0x800) |= 1 << 12;
    at(kUsb + 0x800) |= 1 << 15;
    at(kUsb + 0x800) &= ~(1u << 14);
    wait_for(kUsb + 0x804, 1 << 14);
    at(kUsb) &= ~(1u << 12);
    at(kUsb + 0x18) = 1 << 3;
}

// Serial

uint8_t ring[128];
volatile uint32_t head, tail;

void serial_begin() {
    enable_clock(8);
    at(kUart + 0x120) = 1 << 1 | 1 << 9;
    at(kUart) = 0xAC;
    at(kUart + 4) = 4 << 9;
    at(kUart + 0x20) = 84000000 / 250000 >> 4;
    at(kUart + 0x0C) = 0xFFFFFFFF;
    at(kUart + 0x08) = 1 | 1 << 5 | 1 << 6;
    at(kNvic) = 1 << 8;
    at(kUart) = 1 << 4 | 1 << 6;
}

void serial_write(uint8_t byte) {
    if (!(at(kUart + 0x14) & 2) || head != tail) {
        const uint32_t next = (head + 1) % sizeof ring;
        while (next == tail) {
        }
        ring[head] = byte;
        head = next;
        at(kUart + 0x08) = 2;
    } else {
        at(kUart + 0x1C) = byte;
    }
}

// Wire

void wire_begin() {
    enable_clock(23);
    give_to_peripheral_a(kPio[1], 1 << 12 | 1 << 13, false);
    at(kNvic + 0x80) = 1 << 23;
    at(kNvic + 0x180) = 1 << 23;
    *reinterpret_cast<volatile uint8_t*>(0xE000E400 + 23) = 0;
    at(kNvic) = 1 << 23;
    at(kTwi + 0x120) = 1 << 1 | 1 << 9;
    at(kTwi) = 1 << 4;
    at(kTwi) = 1 << 7;
    const uint32_t ignored = at(kTwi + 0x30);
    (void)ignored;
    at(kTwi) = 1 << 5 | 1 << 3;
    at(kTwi) = 1 << 2;
    at(kTwi + 0x10) = 0;
    at(kTwi + 0x10) = 101 << 8 | 101;
}

bool wire_wait(uint32_t flag) {
    for (uint32_t left = 100000; left; --left) {
        const uint32_t status = at(kTwi + 0x20);
        if (status & 1 << 8) return false;
        if (status & flag) return true;
    }
    return false;
}

size_t wire_read(uint32_t reg, uint8_t* out, size_t n) {
    at(kTwi + 4) = 0;
    at(kTwi + 4) = 1 << 8 | 1 << 12 | kSensor << 16;
    at(kTwi + 0x0C) = 0;
    at(kTwi + 0x0C) = reg;
    at(kTwi) = 1;
    size_t got = 0;
    do {
        if (got + 1 == n) at(kTwi) |= 2;
        if (!wire_wait(2)) break;
        out[got++] = static_cast<uint8_t>(at(kTwi + 0x30));
    } while (got < n);
    wire_wait(1);
    return got;
}

bool wire_write(uint8_t reg, uint8_t value) {
    at(kTwi + 4) = 0;
    at(kTwi + 4) = kSensor << 16;
    at(kTwi + 0x0C) = 0;
    at(kTwi + 0x0C) = 0;
    at(kTwi + 0x34) = reg;
    if (!wire_wait(4)) return false;
    at(kTwi + 0x34) = value;
    if (!wire_wait(4)) return false;
    at(kTwi) = 2;
    return wire_wait(1);
}

void on_systick() { ++tick_ms; }

void on_uart() {
    if (!(at(kUart + 0x14) & 2)) return;
    if (tail != head) {
        at(kUart + 0x1C) = ring[tail];
        tail = (tail + 1) % sizeof ring;
    } else {
        at(kUart + 0x0C) = 2;
    }
}

void unexpected() {
    for (;;) {
    }
}

}  // namespace

extern "C" {

extern uint32_t data_load, data_begin, data_end, bss_begin, bss_end, stack_end;

void reset() {
    const uint32_t* from = &data_load;
    for (uint32_t* to = &data_begin; to < &data_end;) *to++ = *from++;
    for (uint32_t* to = &bss_begin; to < &bss_end;) *to++ = 0;
    at(0xE000ED08) = 0x00080000;

    at(0x400E1A54) = 1 << 15;  // this turns the watchdog off
    set_clocks();
    start_systick();
    set_pins();
    set_analogue();
    delay(1);
    start_usb();
    serial_begin();
    wire_begin();
    wire_write(0x6B, 0x80);
    delay(100);
    wire_write(0x6B, 0x01);
    delay(10);
    for (uint32_t due = micros();;) {
        due += 10000;
        while (static_cast<int32_t>(micros() - due) < 0) {
        }
        const uint32_t now = micros();
        uint8_t record[20];
        record[0] = 'S';
        record[1] = static_cast<uint8_t>(wire_read(0x3B, record + 6, 14));
        for (int i = 0; i < 4; ++i) record[2 + i] = static_cast<uint8_t>(now >> 8 * i);
        for (uint8_t byte : record) serial_write(byte);
    }
}

__attribute__((section(".vectors"), used)) void* const vectors[16 + 45] = {
    &stack_end,
    reinterpret_cast<void*>(reset),
    reinterpret_cast<void*>(unexpected),
    reinterpret_cast<void*>(unexpected),
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    reinterpret_cast<void*>(on_systick),
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    reinterpret_cast<void*>(on_uart),
};
}
