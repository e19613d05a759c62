// When bytes of a port came.
#pragma once

#include <cstdint>

namespace fltea {

struct Stamp {
    std::int64_t host_ns;         // of the clock that fltea.records.clock reads
    std::int64_t unix_offset_ns;  // to be added to it to get Unix time; 0 if that cannot be
};

// One successful read of a port: where it ends in the bytes taken together with it, and when it came.
struct PortRead {
    std::int64_t end;
    Stamp stamp;
};

}  // namespace fltea
