// Converts a list of reads of a port (PortRead) to numpy columns.
#pragma once

#include <vector>

#include "numpy_binding.hpp"
#include "port_read.hpp"

// Returns the columns end, host_ns and unix_offset_ns of n reads, each as an int64 array of shape (n,).
inline nanobind::tuple columns_of(const std::vector<fltea::PortRead>& reads) {
    const std::size_t n = reads.size();
    NumpyTable table(3 * n * sizeof(std::int64_t));
    auto* const end = table.room<std::int64_t>(n);
    auto* const host_ns = table.room<std::int64_t>(n);
    auto* const unix_offset_ns = table.room<std::int64_t>(n);
    for (std::size_t k = 0; k < n; ++k) {
        end[k] = reads[k].end;
        host_ns[k] = reads[k].stamp.host_ns;
        unix_offset_ns[k] = reads[k].stamp.unix_offset_ns;
    }
    const nanobind::tuple shape = nanobind::make_tuple(n);
    return nanobind::make_tuple(table.array(end, shape), table.array(host_ns, shape),
                                table.array(unix_offset_ns, shape));
}
