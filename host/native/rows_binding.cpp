// Makes the parser of rows of numbers in text available in Python as fltea._native.plain_rows
// (host/fltea/recording/text_numbers.py).
#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

#include <utility>
#include <vector>

#include "engine_binding.hpp"
#include "numpy_binding.hpp"
#include "plain_rows.hpp"

namespace nb = nanobind;

namespace {

nb::tuple plain_rows(nb::bytes text, size_t begin, char separator, size_t least, size_t most,
                     std::vector<size_t> places, char decimal) {
    if (begin > text.size()) throw nb::value_error("begin is greater than the length of the text");
    if (places.empty()) throw nb::value_error("places must name at least one column");
    const std::string_view data =
        std::string_view(static_cast<const char*>(text.data()), text.size()).substr(begin);
    const size_t width = places.size(), most_rows = fltea::PlainRows::lines_in(data);
    fltea::PlainRows rows({separator, least, most, std::move(places)}, decimal);
    NumpyTable table(most_rows * (sizeof(int64_t) + width * sizeof(double)));
    double* const values = table.room<double>(most_rows * width);
    int64_t* const lines = table.room<int64_t>(most_rows);
    size_t next = 0;
    {
        const LockGivenAway given(most_rows);
        next = begin + rows.read(data, values, lines);
    }
    return nb::make_tuple(next, rows.passed, rows.decimal(), table.array(lines, nb::make_tuple(rows.rows)),
                          table.array(values, nb::make_tuple(rows.rows, width)));
}

}  // namespace

void bind_rows(nb::module_& m) {
    m.def("plain_rows", &plain_rows, nb::arg("text"), nb::arg("begin"), nb::arg("separator"),
          nb::arg("least"), nb::arg("most"), nb::arg("places"), nb::arg("decimal"));
}
