// Arrival times of bytes on a serial port.
#pragma once

#include <cstdint>

namespace fltea {

struct Stamp {
    std::int64_t host_ns;         // host time, on the clock that fltea.records.clock reads
    std::int64_t unix_offset_ns;  // Unix time minus host time; 0 if Unix time is not known
};

// One successful read of a port. The bytes of several reads may be fetched together; `end` is the offset in
// them at which this read ends.
// `stamp`: arrival time of the bytes.
struct PortRead {
    std::int64_t end;
    Stamp stamp;
};

}  // namespace fltea
