// What a thread waits for with poll(2), and is rung by who need not have Python's lock.
//
// A thread that is woken up by who goes on with the lock finds it taken, and takes the processor twice. It is
// a descriptor, so that the waiting is Python's own: when Python ends, it ends threads that wait in it.
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
        // It fails only where it has been rung 2^64 - 2 times.
        if (::write(number(), &one, sizeof one) < 0) errno = 0;
    }

    // From now on it has not been rung.
    void clear() const {
        std::uint64_t times = 0;
        if (::read(number(), &times, sizeof times) < 0) errno = 0;
    }

  private:
    Descriptor descriptor_;
};

}  // namespace fltea
