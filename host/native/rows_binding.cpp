// fltea._native.plain_rows: lines of text as rows of numbers (host/fltea/recording/text_numbers.py).
#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "engine_binding.hpp"
#include "numpy_binding.hpp"
#include "plain_rows.hpp"

namespace nb = nanobind;

namespace {

constexpr size_t kManyBytes = 1 << 12;

nb::tuple plain_rows(nb::bytes text, size_t begin, char separator, size_t least, size_t most,
                     std::vector<size_t> places, char decimal) {
    if (begin > text.size()) throw nb::value_error("begins behind the end");
    if (places.empty()) throw nb::value_error("no column is read");
    const std::string_view data(static_cast<const char*>(text.data()), text.size());
    const size_t width = places.size();
    fltea::PlainRows rows({separator, least, most, std::move(places)}, decimal);
    size_t next = 0;
    {
        const LockGivenAway given(text.size() - begin >= kManyBytes ? kManyBytes : 0);
        next = begin + rows.read(data.substr(begin));
    }
    const size_t count = rows.lines.size();
    NumpyTable table(count * (sizeof(int64_t) + width * sizeof(double)));
    double* const values = table.room<double>(count * width);
    int64_t* const lines = table.room<int64_t>(count);
    std::copy(rows.values.begin(), rows.values.end(), values);
    std::copy(rows.lines.begin(), rows.lines.end(), lines);
    return nb::make_tuple(next, rows.passed, rows.decimal(), table.array(lines, nb::make_tuple(count)),
                          table.array(values, nb::make_tuple(count, width)));
}

}  // namespace

void bind_rows(nb::module_& m) {
    m.def("plain_rows", &plain_rows, nb::arg("text"), nb::arg("begin"), nb::arg("separator"),
          nb::arg("least"), nb::arg("most"), nb::arg("places"), nb::arg("decimal"));
}
