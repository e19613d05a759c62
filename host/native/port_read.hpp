// Arrival times of bytes on a port.
#pragma once

#include <cstdint>

namespace fltea {

struct Stamp {
    std::int64_t host_ns;         // on the clock that fltea.records.clock reads
    std::int64_t unix_offset_ns;  // added to host_ns it gives Unix time; 0 if Unix time is not known
};

// One successful read of a port: its end in the bytes that were taken together, and its arrival time.
struct PortRead {
    std::int64_t end;
    Stamp stamp;
};

}  // namespace fltea
