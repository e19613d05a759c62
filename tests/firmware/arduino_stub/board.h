// The board behind the stub: virtual time, two I2C lines, a sensor whose failures can be scripted, a UART, a
// watchdog. Times are nanoseconds since boot.
#pragma once

#include <stdint.h>

#include <vector>

namespace stub {

constexpr int kForEver = -1;

// A register file of an MPU-9250 (RM-MPU-9250A-00) and its faults.
struct Chip {
    Chip() { power_up(); }
    void power_up();

    uint8_t registers[128];
    bool plugged_in = true;
    int nacks = 0;        // transfers yet to be refused
    int stalls = 0;       // transfers yet to hang until Wire gives up
    int stall_after = 0;  // bytes of a read that come before it hangs
    int short_by = 0;     // bytes that the next read lacks
    int held_clocks = 0;  // SDA is low until this many clocks have come; kForEver
    bool scl_held = false;
};

struct Pin {
    enum Owner { port, wire };
    uint32_t mode = 0;      // as on the silicon
    uint32_t believed = 9;  // as pinMode remembers it; 9: never set
    bool latch = false;     // the level that digitalWrite set
    Owner owner = port;
};

struct Board {
    uint64_t now_ns = 0;
    Chip chip;
    Pin pins[80];
    bool interrupts_on = true;
    // the time since interrupts are masked; the time that micros() has lost by that
    uint64_t masked_ns = 0, lost_ns = 0;

    // Bus
    uint32_t wire_hz = 0;
    // the controller hangs and pulls SDA low, until the pins are taken from it
    bool controller_hangs = false;
    int wire_begins = 0;
    int clocks = 0;          // rising edges of SCL made by setting pins
    int stops = 0;           // STOP conditions made by setting pins
    int drives = 0;          // times that a line was driven high
    int remains = -1;        // byte of a refused write that stays in the controller and is sent first
    int stale_reads = 0;     // number of future complete reads that leave a byte in the controller
    bool byte_left = false;  // such a byte is there, and the next read takes it for its first
    int spins = 0;           // transfers that reached Wire's time limit

    // UART
    uint32_t baud = 0;
    std::vector<uint8_t> sent;
    uint64_t idle_ns = 0;     // when the last byte will have left
    bool waited = false;      // a write found the ring full
    bool line_stuck = false;  // the UART sends nothing

    // Watchdog
    uint64_t watchdog_ns = 0;  // its time-out; 0: off
    uint64_t fed_ns = 0;
    uint64_t longest_hunger_ns = 0;

    // Data-ready pin
    void (*on_edge)() = nullptr;
    uint32_t edge_pin = 0, edge_mode = 0;
    uint64_t next_edge_ns = 0;
    bool int_wire = true;

    // Chip
    uint32_t random = 0x12345678;
    bool trng_clocked = false, trng_on = false, trng_silent = false;
    uint32_t flash_mode = 0x400;
    bool shows_identifier = false;
    bool fetched_with_interrupts = false;
    uint32_t rsttyp = 4;

    bool low(uint32_t pin) const;
    void advance(uint64_t ns);
};

extern Board board;

}  // namespace stub
