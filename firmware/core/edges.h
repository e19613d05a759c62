// Passes the number of edges on the sensor's data-ready pin, and the time of the last edge, from the
// interrupt handler to the main loop.
#pragma once

#include <stdint.h>

#include <atomic>

namespace fltea {

class Edges {
  public:
    struct Seen {
        uint32_t count;    // number of edges since boot; the number wraps
        uint32_t last_us;  // time of the last edge
    };

    // Notes an edge. Only the interrupt handler calls this.
    void add(uint32_t now_us) {
        last_us_.store(now_us, std::memory_order_relaxed);
        count_.store(count_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
    }

    // Reads the number of edges and the time of the last edge. The main loop calls this. If an edge comes
    // between these two reads, the count changes and both are read again, so that count and time belong to
    // the same edge.
    Seen seen() const {
        for (;;) {
            const uint32_t count = count_.load(std::memory_order_acquire);
            const uint32_t last_us = last_us_.load(std::memory_order_acquire);
            if (count_.load(std::memory_order_acquire) == count) return {count, last_us};
        }
    }

  private:
    std::atomic<uint32_t> last_us_{0};
    std::atomic<uint32_t> count_{0};
};

}  // namespace fltea
