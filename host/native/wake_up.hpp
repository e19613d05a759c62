// Wakes a thread that waits in poll(2). The thread that wakes it does not need Python's GIL for that.
//
// If the waking thread held the GIL, the woken thread would have to wait for it, and be scheduled twice. A
// WakeUp is a file descriptor, so that Python itself can wait for it. When Python exits, it ends threads that
// wait in this way.
#pragma once

#include <sys/eventfd.h>

#include <cerrno>
#include <cstdint>
#include <system_error>

#include "descriptor.hpp"

namespace fltea {

class WakeUp {
  public:
    WakeUp() : descriptor_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
        if (number() < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
    }

    int number() const { return descriptor_.number(); }

    void ring() const {
        const std::uint64_t one = 1;
        // The write fails only if the counter is full, after 2^64 - 2 calls.
        if (::write(number(), &one, sizeof one) < 0) errno = 0;
    }

    // Resets the wake-up, so that the next wait does not return at once.
    void clear() const {
        std::uint64_t times = 0;
        if (::read(number(), &times, sizeof times) < 0) errno = 0;
    }

  private:
    Descriptor descriptor_;
};

}  // namespace fltea
