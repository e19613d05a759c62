// Runs the sketch in virtual time, with scripted faults, and writes to stdout the bytes that it sent.
// arduino_run SECONDS [KIND=AT,AMOUNT …] e.g. arduino_run 5 held=2.0,9 nacks=3.0,4 The last line on stderr
// summarises what happened to the board. A fault KIND begins AT seconds after the start. For nacks, stalls,
// short and stale, AMOUNT is a number of transfers. For held it is a number of clocks (-1: for ever). For
// scl, unplug, deaf (the UART sends nothing) and noint (no edges of the data-ready pin), it is a time in
// seconds. brownout ignores AMOUNT.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <string>
#include <vector>

#include "Arduino.h"
#include "board.h"

using stub::board;

namespace {

struct Trouble {
    std::string kind;
    double at_s, amount;
    bool begun = false, ended = false;
};

void begin(const Trouble& trouble) {
    stub::Chip& chip = board.chip;
    const int n = static_cast<int>(trouble.amount);
    if (trouble.kind == "nacks") chip.nacks = n;
    if (trouble.kind == "stalls") chip.stalls = n;
    if (trouble.kind == "short") chip.short_by = n;
    if (trouble.kind == "stale") board.stale_reads = n;
    if (trouble.kind == "held") chip.held_clocks = n;
    if (trouble.kind == "scl") chip.scl_held = true;
    if (trouble.kind == "unplug") chip.plugged_in = false;
    if (trouble.kind == "brownout") chip.power_up();
    if (trouble.kind == "deaf") board.line_stuck = true;
    if (trouble.kind == "noint") board.int_wire = false;
}

void end(const Trouble& trouble) {
    if (trouble.kind == "scl") board.chip.scl_held = false;
    if (trouble.kind == "unplug") {
        board.chip.plugged_in = true;
        board.chip.power_up();
    }
    if (trouble.kind == "deaf") board.line_stuck = false;
    if (trouble.kind == "noint") board.int_wire = true;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 2) return 2;
    const double seconds = atof(argv[1]);
    std::vector<Trouble> troubles;
    for (int i = 2; i < argc; ++i) {
        char kind[16];
        double at_s = 0, amount = 0;
        if (sscanf(argv[i], "%15[a-z]=%lf,%lf", kind, &at_s, &amount) < 2) return 2;
        troubles.push_back({kind, at_s, amount});
    }
    watchdogSetup();
    setup();
    uint64_t longest_ns = 0;
    while (static_cast<double>(board.now_ns) < seconds * 1e9) {
        const double now_s = static_cast<double>(board.now_ns) * 1e-9;
        for (Trouble& trouble : troubles) {
            if (!trouble.begun && now_s >= trouble.at_s) {
                trouble.begun = true;
                begin(trouble);
            }
            if (!trouble.ended && now_s >= trouble.at_s + trouble.amount) {
                trouble.ended = true;
                end(trouble);
            }
        }
        const uint64_t began_ns = board.now_ns;
        loop();
        if (board.now_ns - began_ns > longest_ns) longest_ns = board.now_ns - began_ns;
    }
    fwrite(board.sent.data(), 1, board.sent.size(), stdout);
    fprintf(
        stderr,
        "{\"baud\": %u, \"waited\": %s, \"longest_us\": %llu, \"hunger_us\": %llu, \"watchdog_us\": %llu, ",
        board.baud, board.waited ? "true" : "false", static_cast<unsigned long long>(longest_ns / 1000),
        static_cast<unsigned long long>(board.longest_hunger_ns / 1000),
        static_cast<unsigned long long>(board.watchdog_ns / 1000));
    fprintf(stderr, "\"spins\": %d, \"edge_pin\": %u, \"edge_mode\": %u}\n", board.spins, board.edge_pin,
            board.edge_mode);
    return 0;
}
