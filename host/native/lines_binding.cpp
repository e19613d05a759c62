// fltea._native.Lines: rows of columns as lines of JSON (host/fltea/sinks/lines.py), as msgspec writes them.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine_binding.hpp"

namespace nb = nanobind;

namespace {

using Column = nb::ndarray<nb::ro, nb::device::cpu>;

// No number takes more, its sign and exponent included.
constexpr size_t kLongest = 32;

// The shortest digits that give the number back; positional from 1e-5 to below 1e16, as msgspec has it.
char* put_real(double value, char* out) {
    char text[kLongest], digits[kLongest];
    const char* end = std::to_chars(text, text + kLongest, value, std::chars_format::scientific).ptr;
    const char* from = text;
    if (*from == '-') *out++ = *from++;
    int n = 0;
    for (; *from != 'e'; ++from)
        if (*from != '.') digits[n++] = *from;
    int exponent = 0;
    std::from_chars(from + (from[1] == '+' ? 2 : 1), end, exponent);
    const int whole = exponent + 1;  // digits before the point
    if (exponent < -5 || exponent > 15) {
        *out++ = digits[0];
        if (n > 1) *out++ = '.';
        out = std::copy(digits + 1, digits + n, out);
        *out++ = 'e';
        return std::to_chars(out, out + kLongest, exponent).ptr;
    }
    if (whole <= 0) {
        *out++ = '0';
        *out++ = '.';
        out = std::fill_n(out, -whole, '0');
        return std::copy(digits, digits + n, out);
    }
    out = std::copy(digits, digits + std::min(n, whole), out);
    out = std::fill_n(out, std::max(0, whole - n), '0');
    *out++ = '.';
    if (n <= whole) *out++ = '0';
    return std::copy(digits + std::min(n, whole), digits + n, out);
}

class Lines {
  public:
    // texts: what stands before each hole, and after the last one. holes: (column, place in its row).
    // nulls: numbers that are not finite are null; else they are left out with their key.
    Lines(const std::vector<nb::bytes>& texts, std::vector<std::pair<size_t, size_t>> holes, bool nulls)
        : holes_(std::move(holes)), nulls_(nulls) {
        if (texts.size() != holes_.size() + 1)
            throw nb::value_error("a text stands before and after each hole");
        for (const nb::bytes& text : texts) {
            texts_.emplace_back(static_cast<const char*>(text.data()), text.size());
            room_ += text.size() + kLongest;
        }
    }

    // Adds rows begin, begin + step, … of the columns, of which those without a hole may be anything.
    void add(nb::bytearray into, nb::list columns, size_t begin, size_t end, size_t step) const {
        std::vector<std::optional<Column>> held(columns.size());
        std::vector<Cells> cells;
        for (const auto& [column, place] : holes_) {
            if (column >= held.size()) throw nb::value_error("a hole without a column");
            if (!held[column]) held[column] = nb::cast<Column>(columns[column]);
            cells.push_back(cells_of(*held[column], place, end));
        }
        if (step == 0) throw nb::value_error("rows follow one another");
        const size_t rows = begin < end ? (end - begin - 1) / step + 1 : 0;
        const size_t before = into.size();
        into.resize(before + rows * room_);
        char* const first = static_cast<char*>(into.data()) + before;
        char* out = first;
        {
            const LockGivenAway given(rows);
            for (size_t row = begin, i = 0; i < rows; ++i, row += step)
                out = write_row(cells, static_cast<int64_t>(row), out);
        }
        into.resize(before + static_cast<size_t>(out - first));
    }

  private:
    enum class Kind { kReal, kInteger, kFlag };
    struct Cells {
        const char* first;
        int64_t stride;  // bytes from a row to the next
        Kind kind;
    };

    static Cells cells_of(const Column& column, size_t place, size_t rows) {
        const nb::dlpack::dtype type = column.dtype();
        Kind kind = Kind::kFlag;
        if (type == nb::dtype<double>()) {
            kind = Kind::kReal;
        } else if (type == nb::dtype<int64_t>()) {
            kind = Kind::kInteger;
        } else if (type != nb::dtype<bool>()) {
            throw nb::value_error("a column holds doubles, 64-bit integers or flags");
        }
        const size_t width = column.ndim() == 1 ? 1 : column.ndim() == 2 ? column.shape(1) : 0;
        if (place >= width || rows > column.shape(0)) throw nb::value_error("a column is too small");
        const int64_t size = type.bits / 8,
                      shift = place ? static_cast<int64_t>(place) * column.stride(1) : 0;
        return {static_cast<const char*>(column.data()) + shift * size, column.stride(0) * size, kind};
    }

    char* write_row(const std::vector<Cells>& cells, int64_t row, char* out) const {
        bool first = false;  // of its object: the one before it was left out
        for (size_t i = 0; i <= cells.size(); ++i) {
            const std::string& text = texts_[i];
            const size_t skipped = first && text.front() == ',' ? 1 : 0;
            out = std::copy(text.begin() + static_cast<std::ptrdiff_t>(skipped), text.end(), out);
            first = false;
            if (i == cells.size()) break;
            const char* const at = cells[i].first + row * cells[i].stride;
            if (cells[i].kind == Kind::kFlag) {
                out = put(*at ? "true" : "false", out);
            } else if (cells[i].kind == Kind::kInteger) {
                out = std::to_chars(out, out + kLongest, *reinterpret_cast<const int64_t*>(at)).ptr;
            } else if (const double value = *reinterpret_cast<const double*>(at); std::isfinite(value)) {
                out = put_real(value, out);
            } else if (nulls_ || out[-1] != ':') {
                out = put("null", out);
            } else {
                for (out -= 2; out[-1] != '"';) --out;
                --out;
                first = out[-1] == '{';
                if (!first) --out;
            }
        }
        return out;
    }

    static char* put(const char* word, char* out) { return std::copy(word, word + std::strlen(word), out); }

    std::vector<std::string> texts_;
    std::vector<std::pair<size_t, size_t>> holes_;
    bool nulls_;
    size_t room_ = 0;
};

}  // namespace

void bind_lines(nb::module_& m) {
    nb::class_<Lines>(m, "Lines")
        .def(nb::init<const std::vector<nb::bytes>&, std::vector<std::pair<size_t, size_t>>, bool>(),
             nb::arg("texts"), nb::arg("holes"), nb::arg("nulls"))
        .def("add", &Lines::add, nb::arg("into"), nb::arg("columns"), nb::arg("begin"), nb::arg("end"),
             nb::arg("step"));
}
