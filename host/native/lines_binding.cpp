// Makes the classes that print rows of columns as JSON lines available in Python as fltea._native.Lines and
// fltea._native.RunPrinter (host/fltea/sinks/json_lines.py).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine_binding.hpp"
#include "line_printer.hpp"
#include "run_printer.hpp"

namespace nb = nanobind;

namespace {

using Column = nb::ndarray<nb::ro, nb::device::cpu>;
using fltea::Cells;
using fltea::LinePrinter;
using fltea::RunPrinter;

class Lines {
  public:
    Lines(const std::vector<nb::bytes>& texts, const std::vector<std::pair<size_t, size_t>>& holes,
          bool nulls) {
        std::vector<std::string> own;
        for (const nb::bytes& text : texts)
            own.emplace_back(static_cast<const char*>(text.data()), text.size());
        std::vector<LinePrinter::Hole> places;
        for (const auto& [column, place] : holes) places.push_back({column, place});
        printer_ = std::make_shared<const LinePrinter>(std::move(own), std::move(places), nulls);
    }

    // Prints the rows begin, begin + step, … of the columns. Columns that do not occur in a line are ignored.
    void add(nb::bytearray into, nb::list columns, size_t begin, size_t end, size_t step) const {
        std::vector<std::optional<Column>> held(columns.size());
        std::vector<Cells> cells(columns.size());
        for (const auto& [column, place] : printer_->holes()) {
            if (column >= held.size()) throw nb::value_error("a line prints a column that is not given");
            if (!held[column]) {
                held[column] = nb::cast<Column>(columns[column]);
                cells[column] = cells_of(*held[column]);
            }
            if (place >= width_of(*held[column]) || end > held[column]->shape(0))
                throw nb::value_error("a column is too small");
        }
        if (step == 0) throw nb::value_error("step must be above 0");
        const size_t rows = begin < end ? (end - begin - 1) / step + 1 : 0;
        const size_t before = into.size();
        into.resize(before + printer_->room(rows));
        char* const first = static_cast<char*>(into.data()) + before;
        char* out = first;
        {
            const LockGivenAway given(rows);
            out = printer_->print(cells.data(), begin, end, step, first);
        }
        into.resize(before + static_cast<size_t>(out - first));
    }

    const std::shared_ptr<const LinePrinter>& printer() const { return printer_; }

  private:
    static size_t width_of(const Column& column) {
        return column.ndim() == 1 ? 1 : column.ndim() == 2 ? column.shape(1) : 0;
    }

    static Cells cells_of(const Column& column) {
        const nb::dlpack::dtype type = column.dtype();
        Cells::Kind kind = Cells::kFlag;
        if (type == nb::dtype<double>()) {
            kind = Cells::kReal;
        } else if (type == nb::dtype<int64_t>()) {
            kind = Cells::kWhole;
        } else if (type != nb::dtype<bool>()) {
            throw nb::value_error("a column holds doubles, 64-bit integers or flags");
        }
        if (width_of(column) == 0) throw nb::value_error("a column is too small");
        const int64_t size = type.bits / 8, place = column.ndim() == 2 ? column.stride(1) : 0;
        return {column.data(), column.stride(0) * size, place * size, kind};
    }

    std::shared_ptr<const LinePrinter> printer_;
};

// Returns the text that was printed since the last call, the number of records in it, and the number of rows
// after it that were not printed, because their columns are not those that the printer expects.
std::tuple<nb::bytes, size_t, size_t> take(RunPrinter& printer) {
    const std::tuple<nb::bytes, size_t, size_t> found = {nb::bytes(printer.data(), printer.size()),
                                                         printer.records(), printer.missed()};
    printer.clear();
    return found;
}

}  // namespace

void bind_lines(nb::module_& m) {
    nb::class_<Lines>(m, "Lines")
        .def(nb::init<const std::vector<nb::bytes>&, const std::vector<std::pair<size_t, size_t>>&, bool>(),
             nb::arg("texts"), nb::arg("holes"), nb::arg("nulls"))
        .def("add", &Lines::add, nb::arg("into"), nb::arg("columns"), nb::arg("begin"), nb::arg("end"),
             nb::arg("step"));
    nb::class_<RunPrinter>(m, "RunPrinter")
        .def(
            "__init__",
            [](RunPrinter* at, const Lines& lines, std::int64_t every, size_t weight, fltea::RunShape shape) {
                new (at) RunPrinter(lines.printer(), every, weight, std::move(shape));
            },
            nb::arg("lines"), nb::arg("every"), nb::arg("weight"), nb::arg("shape"))
        .def("take", &take);
}
