#include "board.h"

#include "Arduino.h"
#include "Wire.h"

UARTClass Serial;
TwoWire Wire;
Trng stub_trng;
Efc stub_efc0;
Rstc stub_rstc;
Twi stub_twi1;

namespace stub {

Board board;

namespace {

constexpr uint64_t kUs = 1000;
constexpr uint64_t kBitNs = 2500;  // duration of a bit at 400 kHz
// duration of the 100,000 waiting loops after which Wire gives up a transfer (firmware/README.md)
constexpr uint64_t kSpinNs = 27500 * kUs;
constexpr int kRing = 128;
constexpr uint8_t kAddress = 0x68;

enum Reg : uint8_t { kSmplrtDiv = 0x19, kIntEnable = 0x38, kBurst = 0x3B, kPwrMgmt1 = 0x6B, kWhoAmI = 0x75 };

const uint32_t kIdentifier[4] = {0x03020100, 0x07060504, 0x0B0A0908, 0x0F0E0D0C};
const uint32_t kProgram[4] = {0x20088000, 0x000800F1, 0x000800E5, 0x000800E5};

// Returns the duration of a byte on the UART, which is ten bits. Before begin() has set the baud rate,
// 250,000 baud count, because some tests write to the UART that early.
uint64_t byte_ns() { return 10000000000ull / (board.baud ? board.baud : 250000); }

uint64_t edge_period_ns() { return (board.chip.registers[kSmplrtDiv] + 1u) * 1000 * kUs; }

// Whether the data-ready pin floats: it is connected to nothing, so it picks up edges from its surroundings.
bool floats() {
    const Pin& pin = board.pins[board.edge_pin];
    return !board.int_wire && !(pin.owner == Pin::port && pin.mode == INPUT_PULLUP);
}

bool edges_run() {
    const Chip& chip = board.chip;
    if (board.on_edge == nullptr) return false;
    return floats() || (board.int_wire && chip.plugged_in && (chip.registers[kIntEnable] & 1) != 0);
}

// Simulates a transfer of `bits` bits, which takes its usual time and returns true. The transfer fails if it
// hangs, if a line of the bus is held low, or if the pins are not connected to the controller. A failed
// transfer returns false, and takes `waits` time limits of Wire, the Arduino library for I2C.
bool transfer(unsigned bits, unsigned waits) {
    const bool connected =
        board.pins[PIN_WIRE_SDA].owner == Pin::wire && board.pins[PIN_WIRE_SCL].owner == Pin::wire;
    const bool stalls = board.chip.stalls > 0;
    if (stalls) {
        --board.chip.stalls;
        board.controller_hangs = true;
    }
    if (stalls || !connected || board.low(PIN_WIRE_SDA) || board.low(PIN_WIRE_SCL)) {
        ++board.spins;
        board.advance(waits * kSpinNs);
        return false;
    }
    board.advance(bits * kBitNs);
    return true;
}

bool acknowledged(uint8_t address) {
    Chip& chip = board.chip;
    if (!chip.plugged_in || address != kAddress) return false;
    if (chip.nacks == 0) return true;
    if (chip.nacks > 0) --chip.nacks;
    return false;
}

void write_register(uint8_t reg, uint8_t value) {
    if (reg == kPwrMgmt1 && (value & 0x80) != 0) {
        board.chip.power_up();
    } else {
        board.chip.registers[reg & 0x7F] = value;
    }
}

// The gyroscope's x axis counts milliseconds, so each sample is different and shows its time.
void convert() {
    uint8_t* burst = board.chip.registers + kBurst;
    const uint32_t ms = static_cast<uint32_t>(board.now_ns / 1000000);
    const uint16_t values[7] = {0, 0, 16384, 1335, static_cast<uint16_t>(ms & 0x3FFF), 2, 3};
    for (int i = 0; i < 7; ++i) {
        burst[2 * i] = static_cast<uint8_t>(values[i] >> 8);
        burst[2 * i + 1] = static_cast<uint8_t>(values[i] & 0xFF);
    }
}

void set_pin(uint32_t pin, uint32_t mode) {
    const bool sda = board.low(PIN_WIRE_SDA), scl = board.low(PIN_WIRE_SCL);
    Pin& p = board.pins[pin];
    p.owner = Pin::port;
    p.mode = mode;
    if (mode == OUTPUT && p.latch) ++board.drives;
    if (pin == PIN_WIRE_SCL && scl && mode != OUTPUT) {
        ++board.clocks;
        if (board.chip.held_clocks > 0) --board.chip.held_clocks;
    }
    if (pin == PIN_WIRE_SDA && sda && !board.low(PIN_WIRE_SDA) && !scl) ++board.stops;
}

}  // namespace

void Chip::power_up() {
    for (uint8_t& value : registers) value = 0;
    registers[kPwrMgmt1] = 0x01;
    registers[kWhoAmI] = 0x71;
}

bool Board::low(uint32_t pin) const {
    const Pin& p = pins[pin];
    if (p.owner == Pin::port && p.mode == OUTPUT && !p.latch) return true;
    if (pin == PIN_WIRE_SDA && p.owner == Pin::wire && controller_hangs) return true;
    if (pin == PIN_WIRE_SDA) return chip.plugged_in && chip.held_clocks != 0;
    return pin == PIN_WIRE_SCL && chip.plugged_in && chip.scl_held;
}

void Board::advance(uint64_t ns) {
    const uint64_t end_ns = now_ns + ns;
    while (interrupts_on && edges_run() && next_edge_ns <= end_ns) {
        if (next_edge_ns < now_ns) next_edge_ns = now_ns;
        now_ns = next_edge_ns;
        next_edge_ns += edge_period_ns();
        on_edge();
    }
    if (now_ns < end_ns) now_ns = end_ns;
    if (watchdog_ns != 0 && now_ns - fed_ns > longest_hunger_ns) longest_hunger_ns = now_ns - fed_ns;
}

uint32_t read_nothing() { return 0; }
void write_nothing(uint32_t) {}
void trng_control(uint32_t value) {
    if (board.trng_clocked && value >> 8 == 0x524E47) board.trng_on = (value & TRNG_CR_ENABLE) != 0;
}
uint32_t trng_status() { return board.trng_clocked && board.trng_on && !board.trng_silent ? 1 : 0; }
uint32_t trng_data() { return board.random; }
uint32_t flash_mode() { return board.flash_mode; }
void flash_set_mode(uint32_t value) { board.flash_mode = value; }
void flash_command(uint32_t value) {
    if (value >> 24 != 0x5A) return;
    if ((value & 0xFF) == 0x0E) board.shows_identifier = (board.flash_mode & EEFC_FMR_SCOD) != 0;
    if ((value & 0xFF) == 0x0F) board.shows_identifier = false;
}
uint32_t flash_status() { return board.shows_identifier ? 0 : EEFC_FSR_FRDY; }
uint32_t reset_status() { return board.rsttyp << 8 | 0x10000; }
uint32_t received_byte() {
    board.byte_left = false;
    return 0xFF;
}
uintptr_t flash_address() {
    board.fetched_with_interrupts |= board.shows_identifier && board.interrupts_on;
    return reinterpret_cast<uintptr_t>(board.shows_identifier ? kIdentifier : kProgram);
}

}  // namespace stub

using stub::board;

extern "C" {

uint32_t pmc_enable_periph_clk(uint32_t id) {
    if (id == ID_TRNG) board.trng_clocked = true;
    return 0;
}
uint32_t pmc_disable_periph_clk(uint32_t id) {
    if (id == ID_TRNG) board.trng_clocked = false;
    return 0;
}

uint32_t micros(void) {
    board.advance(2 * stub::kUs);
    // On the real board, an interrupt handler counts the milliseconds. While interrupts are masked, only one
    // more millisecond can be pending, and later ones are lost.
    const uint64_t most_ns = board.masked_ns + 1999999;
    const uint64_t at_ns = board.interrupts_on || board.now_ns < most_ns ? board.now_ns : most_ns;
    return static_cast<uint32_t>((at_ns - board.lost_ns) / stub::kUs);
}
uint32_t millis(void) { return micros() / 1000; }
void delayMicroseconds(uint32_t usec) { board.advance(usec * stub::kUs); }

// As in the Arduino core, nothing happens if an earlier call has set the same input mode.
void pinMode(uint32_t pin, uint32_t mode) {
    stub::Pin& p = board.pins[pin];
    if (mode != OUTPUT && p.believed == mode) return;
    p.believed = mode;
    stub::set_pin(pin, mode);
}

void digitalWrite(uint32_t pin, uint32_t value) { board.pins[pin].latch = value != LOW; }
int digitalRead(uint32_t pin) { return board.low(pin) ? LOW : HIGH; }

void attachInterrupt(uint32_t pin, void (*callback)(void), uint32_t mode) {
    board.on_edge = callback;
    board.edge_pin = pin;
    board.edge_mode = mode;
    board.next_edge_ns = board.now_ns;
}
}

void __disable_irq() {
    if (board.interrupts_on) board.masked_ns = board.now_ns;
    board.interrupts_on = false;
}
void __enable_irq() {
    if (!board.interrupts_on) {
        const uint64_t masked_ms = (board.now_ns - board.masked_ns) / 1000000;
        if (masked_ms > 1) board.lost_ns += (masked_ms - 1) * 1000000;
    }
    board.interrupts_on = true;
}

void watchdogEnable(uint32_t timeout) {
    board.watchdog_ns = timeout * 1000000ull;
    board.fed_ns = board.now_ns;
}
void watchdogReset(void) { board.fed_ns = board.now_ns; }

size_t Print::write(const uint8_t* buffer, size_t size) {
    for (size_t i = 0; i < size; ++i) write(buffer[i]);
    return size;
}

void UARTClass::begin(const uint32_t baud) { board.baud = baud; }
int UARTClass::available(void) { return 0; }
int UARTClass::peek(void) { return -1; }
int UARTClass::read(void) { return -1; }
void UARTClass::flush(void) {}
int UARTClass::availableForWrite(void) {
    if (board.line_stuck) return 0;
    const uint64_t left_ns = board.idle_ns > board.now_ns ? board.idle_ns - board.now_ns : 0;
    return stub::kRing - 1 - static_cast<int>((left_ns + stub::byte_ns() - 1) / stub::byte_ns());
}
size_t UARTClass::write(const uint8_t value) {
    board.waited |= availableForWrite() <= 0;
    if (board.idle_ns < board.now_ns) board.idle_ns = board.now_ns;
    board.idle_ns += stub::byte_ns();
    board.sent.push_back(value);
    return 1;
}

void TwoWire::begin() {
    ++board.wire_begins;
    board.controller_hangs = board.byte_left = false;
    board.remains = -1;
    board.pins[PIN_WIRE_SDA].owner = board.pins[PIN_WIRE_SCL].owner = stub::Pin::wire;
}
void TwoWire::begin(uint8_t) {}
void TwoWire::begin(int) {}
void TwoWire::end() {}
void TwoWire::setClock(uint32_t hz) { board.wire_hz = hz; }
void TwoWire::beginTransmission(uint8_t address) {
    tx_address_ = address;
    tx_length_ = 0;
}
void TwoWire::beginTransmission(int address) { beginTransmission(static_cast<uint8_t>(address)); }
size_t TwoWire::write(uint8_t value) {
    if (tx_length_ >= BUFFER_LENGTH) return 0;
    tx_[tx_length_++] = value;
    return 1;
}
size_t TwoWire::write(const uint8_t* data, size_t n) {
    size_t done = 0;
    while (done < n && write(data[done]) == 1) ++done;
    return done;
}
uint8_t TwoWire::endTransmission(void) { return endTransmission(static_cast<uint8_t>(true)); }
uint8_t TwoWire::endTransmission(uint8_t) {
    if (!stub::transfer(2 + 9u * (1u + tx_length_), 1)) return 2;
    if (!stub::acknowledged(tx_address_)) {
        board.remains = tx_[0];
        return 2;
    }
    if (board.remains >= 0) {
        stub::write_register(static_cast<uint8_t>(board.remains), tx_[0]);
        board.remains = -1;
    } else if (tx_length_ == 2) {
        stub::write_register(tx_[0], tx_[1]);
    }
    return 0;
}
uint8_t TwoWire::requestFrom(uint8_t address, uint8_t n, uint32_t reg, uint8_t reg_size, uint8_t) {
    // without a register address, register 0 is read: a program must not rely on the chip's own register
    // pointer
    if (reg_size == 0) reg = 0;
    rx_index_ = rx_length_ = 0;
    if (n > BUFFER_LENGTH) n = BUFFER_LENGTH;
    const bool complete = stub::transfer(3 + 9u * (3u + n), 2);
    // Bytes that arrived before the line got stuck are returned.
    if (!complete) n = static_cast<uint8_t>(board.chip.stall_after < n ? board.chip.stall_after : n);
    if (n == 0 || !stub::acknowledged(address)) return 0;
    stub::convert();
    const int length = n - board.chip.short_by;
    board.chip.short_by = 0;
    if (board.byte_left) rx_[rx_length_++] = 0xFF;
    for (uint32_t i = reg; rx_length_ < length; ++i) rx_[rx_length_++] = board.chip.registers[i & 0x7F];
    board.byte_left = board.stale_reads > 0;
    if (board.stale_reads > 0) --board.stale_reads;
    return rx_length_;
}
uint8_t TwoWire::requestFrom(uint8_t address, uint8_t n) { return requestFrom(address, n, 0, 0, 1); }
uint8_t TwoWire::requestFrom(uint8_t address, uint8_t n, uint8_t) { return requestFrom(address, n, 0, 0, 1); }
uint8_t TwoWire::requestFrom(int address, int n) {
    return requestFrom(static_cast<uint8_t>(address), static_cast<uint8_t>(n), 0, 0, 1);
}
uint8_t TwoWire::requestFrom(int address, int n, int) { return requestFrom(address, n); }
int TwoWire::available(void) { return rx_length_ - rx_index_; }
int TwoWire::read(void) { return rx_index_ < rx_length_ ? rx_[rx_index_++] : -1; }
int TwoWire::peek(void) { return rx_index_ < rx_length_ ? rx_[rx_index_] : -1; }
void TwoWire::flush(void) {}
