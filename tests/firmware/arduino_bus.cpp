// Tests of those classes of the Arduino sketch that connect firmware/core with the board. They run with the
// stub of the Arduino libraries.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

// The sketch's files are included after the test framework, because the stub defines macros such as min,
// round and bit, as the real Arduino core does.
#include "board.h"
#include "identity.h"
#include "serial_sink.h"
#include "wire_bus.h"

using fltea::HeldLines;
using fltea::I2cResult;
using stub::board;

namespace {

constexpr uint8_t kAddress = 0x68, kWhoAmI = 0x75, kConfig = 0x1A;

struct Bench {
    Bench() { board = stub::Board(); }
    fltea::WireBus bus{Wire};
};

uint64_t us_since(uint64_t began_ns) { return (board.now_ns - began_ns) / 1000; }

}  // namespace

TEST_CASE_FIXTURE(Bench, "a register is written and read back over a bus of 400 kHz") {
    CHECK(bus.recover() == HeldLines::none);
    CHECK(board.wire_hz == 400000);
    CHECK(bus.write(kAddress, kConfig, 0x05) == I2cResult::ok);
    CHECK(board.chip.registers[kConfig] == 0x05);
    uint8_t data[2] = {};
    CHECK(bus.read(kAddress, kConfig, data, 2) == I2cResult::ok);
    CHECK(data[0] == 0x05);
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
    CHECK(data[0] == 0x71);
    CHECK(board.spins == 0);
}

TEST_CASE_FIXTURE(Bench, "nobody at the address is a NACK, at once") {
    bus.recover();
    uint8_t data[1];
    const uint64_t began_ns = board.now_ns;
    CHECK(bus.read(0x69, kWhoAmI, data, 1) == I2cResult::nack);
    CHECK(bus.write(0x69, kConfig, 0) == I2cResult::nack);
    board.chip.nacks = 1;
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::nack);
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
    CHECK(us_since(began_ns) < 1000);
}

TEST_CASE_FIXTURE(Bench, "fewer bytes than asked for are a short read") {
    bus.recover();
    uint8_t data[14];
    board.chip.short_by = 1;
    CHECK(bus.read(kAddress, 0x3B, data, 14) == I2cResult::short_read);
    CHECK(bus.read(kAddress, 0x3B, data, 14) == I2cResult::ok);
    uint8_t long_one[33];
    CHECK(bus.read(kAddress, 0, long_one, 33) == I2cResult::short_read);
}

TEST_CASE_FIXTURE(Bench, "a byte that a complete read left in the controller is not the next read's") {
    bus.recover();
    board.stale_reads = 2;
    uint8_t data[2] = {};
    for (int i = 0; i < 3; ++i) {
        CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
        CHECK(data[0] == 0x71);
        CHECK(board.byte_left == (i < 2));
    }
    board.stale_reads = 1;
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
    CHECK(bus.read(kAddress, 0x6B, data, 2) == I2cResult::ok);
    CHECK(data[0] == 0x01);
    CHECK(data[1] == 0x00);
}

TEST_CASE_FIXTURE(Bench, "a held line is a time-out that costs no time") {
    bus.recover();
    uint8_t data[1];
    const uint64_t began_ns = board.now_ns;
    board.chip.held_clocks = stub::kForEver;
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::timeout);
    CHECK(bus.write(kAddress, kConfig, 0) == I2cResult::timeout);
    board.chip.held_clocks = 0;
    board.chip.scl_held = true;
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::timeout);
    CHECK(bus.write(kAddress, kConfig, 0) == I2cResult::timeout);
    CHECK(us_since(began_ns) < 100);
    CHECK(board.spins == 0);
}

TEST_CASE_FIXTURE(Bench, "Wire's own time-out is told from a NACK by its length") {
    bus.recover();
    uint8_t data[1];
    board.chip.stalls = 2;
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::timeout);
    CHECK(bus.write(kAddress, kConfig, 0) == I2cResult::timeout);
    CHECK(board.spins == 2);
    // Wire's time-out has reset the I2C controller, so the controller holds no line any more.
    CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
    board.clocks = 0;
    CHECK(bus.recover() == HeldLines::none);
    // the only clock pulse is that of the STOP, because the controller held the line, and not the sensor
    CHECK(board.clocks == 1);
}

TEST_CASE_FIXTURE(Bench,
                  "a line that gets stuck at any byte of a read is a time-out, and the next read is whole") {
    bus.recover();
    // `after`: number of bytes that arrive before the line gets stuck. 0: it gets stuck before the first byte
    // (at the address, the register or the repeated START). 14: it gets stuck after the last byte, at the
    // STOP.
    for (int after = 0; after <= 14; ++after) {
        CAPTURE(after);
        uint8_t data[14] = {};
        board.chip.stalls = 1;
        board.chip.stall_after = after;
        const I2cResult result = bus.read(kAddress, 0x3B, data, 14);
        // If the line gets stuck only at the STOP, all bytes have arrived.
        CHECK((result == I2cResult::timeout || (after == 14 && result == I2cResult::ok)));
        CHECK(bus.recover() == HeldLines::none);
        CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
        CHECK(data[0] == 0x71);
        board.chip.stalls = 1;
        CHECK(bus.write(kAddress, kConfig, 0x03) == I2cResult::timeout);
        CHECK(bus.recover() == HeldLines::none);
        CHECK(bus.write(kAddress, kConfig, 0x05) == I2cResult::ok);
        CHECK(board.chip.registers[kConfig] == 0x05);
    }
}

TEST_CASE_FIXTURE(Bench, "what a refused write leaves in the controller does not go out with the next one") {
    bus.recover();
    board.chip.nacks = 1;
    CHECK(bus.write(kAddress, 0x6B, 0x01) == I2cResult::nack);
    CHECK(bus.write(kAddress, kConfig, 0x05) == I2cResult::ok);
    CHECK(board.chip.registers[kConfig] == 0x05);
    CHECK(board.chip.registers[0x6B] == 0x01);
    CHECK(board.chip.registers[0x6C] == 0x00);
}

TEST_CASE_FIXTURE(Bench,
                  "micros() stands still while interrupts are masked, and loses all but a millisecond") {
    const uint32_t begun_us = micros();
    __disable_irq();
    delayMicroseconds(5000);
    const uint32_t still_us = micros();
    CHECK(still_us - begun_us < 2100);
    delayMicroseconds(5000);
    CHECK(micros() - still_us < 10);
    __enable_irq();
    CHECK(micros() - begun_us < 2200);
}

TEST_CASE_FIXTURE(Bench, "a free bus gets no clocks, one STOP, and Wire again") {
    CHECK(bus.recover() == HeldLines::none);
    CHECK(board.clocks == 1);  // the only clock pulse is that of the STOP
    CHECK(board.stops == 1);
    CHECK(board.wire_begins == 1);
    CHECK(board.drives == 0);
}

TEST_CASE_FIXTURE(Bench, "a held SDA is freed by as many clocks as it needs, nine at most") {
    for (int needed : {1, 8, 9}) {
        CAPTURE(needed);
        board = stub::Board();
        bus.recover();
        board.chip.held_clocks = needed;
        board.clocks = board.stops = 0;
        CHECK(bus.recover() == HeldLines::none);
        CHECK(board.clocks == needed + 1);
        CHECK(board.stops == 1);
        CHECK(board.drives == 0);
        uint8_t data[1];
        CHECK(bus.read(kAddress, kWhoAmI, data, 1) == I2cResult::ok);
    }
    board.chip.held_clocks = 11;  // recover() gives only ten clock pulses: nine, and that of the STOP
    board.clocks = 0;
    CHECK(bus.recover() == HeldLines::sda);
    CHECK(board.clocks == 10);
}

TEST_CASE_FIXTURE(Bench, "recovery works as often as it is asked for, within 0.2 ms") {
    for (int i = 0; i < 5; ++i) {
        board.chip.held_clocks = 9;
        const uint64_t began_ns = board.now_ns;
        CHECK(bus.recover() == HeldLines::none);
        CHECK(us_since(began_ns) < 200);
    }
    CHECK(board.wire_begins == 5);
}

TEST_CASE_FIXTURE(Bench, "lines that stay low are named") {
    board.chip.held_clocks = stub::kForEver;
    CHECK(bus.recover() == HeldLines::sda);
    board.chip.scl_held = true;
    CHECK(bus.recover() == HeldLines::both);
    board.chip.held_clocks = 0;
    CHECK(bus.recover() == HeldLines::scl);
}

TEST_CASE_FIXTURE(Bench, "the sink tells the ring's real room and never waits") {
    fltea::SerialSink sink(Serial);
    CHECK(sink.room() == 127);
    const uint8_t data[100] = {1, 2, 3};
    sink.write(data, 100);
    CHECK(sink.room() == 27);
    board.advance(1000000);
    CHECK(sink.room() == 52);
    sink.write(data, 52);
    CHECK(sink.room() == 0);
    CHECK_FALSE(board.waited);
    CHECK(board.sent.size() == 152);
}

TEST_CASE_FIXTURE(Bench, "the board's identity") {
    board.rsttyp = 2;
    const fltea::Identity identity = fltea::read_identity();
    CHECK(identity.boot_id == 0x12345678);
    for (uint8_t i = 0; i < 16; ++i) CHECK(identity.device_id[i] == i);
    CHECK(std::string(identity.port) == "arduino");
    CHECK(identity.reset_cause == fltea::ResetCause::watchdog);
    CHECK_FALSE(board.shows_identifier);
    CHECK_FALSE(board.fetched_with_interrupts);
    CHECK(board.interrupts_on);
    CHECK(board.flash_mode == 0x400);
    CHECK_FALSE(board.trng_clocked);
}

TEST_CASE_FIXTURE(Bench, "a generator that stays silent does not stop the board") {
    board.trng_silent = true;
    CHECK(fltea::read_identity().boot_id == 0);
}
