// The simulated board behind the stub of the Arduino libraries: virtual time, the two lines of an I2C bus, a
// sensor whose failures can be scripted, a UART and a watchdog. Times are nanoseconds since the board was
// started.
#pragma once

#include <stdint.h>

#include <vector>

namespace stub {

constexpr int kForEver = -1;

// An MPU-9250 as a set of registers (RM-MPU-9250A-00), and its faults.
struct Chip {
    Chip() { power_up(); }
    void power_up();

    uint8_t registers[128];
    bool plugged_in = true;
    int nacks = 0;        // number of future transfers that get a NACK
    int stalls = 0;       // number of future transfers that hang until Wire gives up
    int stall_after = 0;  // number of bytes of a hanging read that arrive before it hangs
    int short_by = 0;     // number of bytes that are missing in the next read
    int held_clocks = 0;  // number of clock pulses after which the chip lets go of SDA; kForEver: never
    bool scl_held = false;
};

struct Pin {
    enum Owner { port, wire };
    uint32_t mode = 0;      // the mode that the pin really has
    uint32_t believed = 9;  // the mode that pinMode() remembers; 9: never set
    bool latch = false;     // the level that digitalWrite() set
    Owner owner = port;
};

struct Board {
    uint64_t now_ns = 0;
    Chip chip;
    Pin pins[80];
    bool interrupts_on = true;
    // masked_ns: time at which interrupts were last masked. lost_ns: total time by which micros() is behind,
    // because milliseconds are not counted while interrupts are masked
    uint64_t masked_ns = 0, lost_ns = 0;

    // Bus
    uint32_t wire_hz = 0;
    // the controller hangs and pulls SDA low, until the pins are used as plain outputs
    bool controller_hangs = false;
    int wire_begins = 0;
    int clocks = 0;  // rising edges of SCL that were made by setting the pin
    int stops = 0;   // STOP conditions that were made by setting pins
    int drives = 0;  // number of times that the program drove a line high, which I2C forbids
    // a byte that was written, but not acknowledged: it stays in the controller and is sent as the first byte
    // of the next write; -1: none
    int remains = -1;
    int stale_reads = 0;  // number of future complete reads that leave a byte in the controller
    // whether a read has left a byte in the controller; the next read returns this byte as its first one
    bool byte_left = false;
    int spins = 0;  // number of transfers that reached Wire's time limit

    // UART
    uint32_t baud = 0;
    std::vector<uint8_t> sent;
    uint64_t idle_ns = 0;     // time at which the last byte will have been sent
    bool waited = false;      // whether a write ever had to wait because the ring buffer was full
    bool line_stuck = false;  // the UART sends nothing

    // Watchdog
    uint64_t watchdog_ns = 0;  // time-out of the watchdog; 0: off
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
