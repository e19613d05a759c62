// Tests what happens if the data-ready interrupt comes at any single instruction of the main loop's code that
// reads the edges. Instead of the interrupt, the single-step trap of this CPU is used. Like an interrupt on a
// Cortex-M, it stops the program anywhere, runs the handler, and continues.
#include <doctest/doctest.h>

#include "edges.h"

#if defined(__x86_64__) && defined(__linux__)

#include <signal.h>
#include <ucontext.h>

namespace {

constexpr greg_t kTrapFlag = 0x100;

fltea::Edges* edges;
uint32_t next_us;
volatile sig_atomic_t steps;
volatile sig_atomic_t interrupt_at;

void step_by_step(int, siginfo_t*, void* context) {
    static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_EFL] |= kTrapFlag;
}

void one_instruction(int, siginfo_t*, void* context) {
    if (++steps < interrupt_at) return;
    edges->add(next_us);
    static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_EFL] &= ~kTrapFlag;
}

void handle(int signal, void (*handler)(int, siginfo_t*, void*)) {
    struct sigaction action = {};
    action.sa_sigaction = handler;
    action.sa_flags = SA_SIGINFO;
    sigaction(signal, &action, nullptr);
}

}  // namespace

TEST_CASE(
    "edges: an interrupt at any instruction of the read never gives a count with another edge's instant") {
    handle(SIGUSR1, step_by_step);
    handle(SIGTRAP, one_instruction);
    int before = 0;
    int after = 0;
    // The edge with number `count` has the time count * 10000. So each pair of number and time that was read
    // shows whether both belong together.
    for (interrupt_at = 1; interrupt_at < 3000; interrupt_at = interrupt_at + 1) {
        fltea::Edges fresh;
        edges = &fresh;
        for (uint32_t n = 1; n <= 5; ++n) fresh.add(n * 10000);
        next_us = 60000;
        steps = 0;
        raise(SIGUSR1);
        const fltea::Edges::Seen seen = fresh.seen();
        while (steps < interrupt_at) {
        }
        REQUIRE(seen.last_us == seen.count * 10000);
        ++(seen.count == 5 ? before : after);
        if (before > 50) break;  // from here on, the interrupt comes after the read of the edges
    }
    CHECK(after > 10);
    CHECK(before > 50);
    signal(SIGUSR1, SIG_DFL);
    signal(SIGTRAP, SIG_DFL);
}

#endif

TEST_CASE("edges: count and instant of the last, through the wrap of both") {
    fltea::Edges edges_;
    CHECK(edges_.seen().count == 0);
    edges_.add(0xFFFFFFF0u);
    CHECK(edges_.seen().count == 1);
    CHECK(edges_.seen().last_us == 0xFFFFFFF0u);
    edges_.add(0x10u);
    CHECK(edges_.seen().count == 2);
    CHECK(edges_.seen().last_us == 0x10u);
}
