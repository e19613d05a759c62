// Prints the rows of several columns as lines of JSON, as the Python package msgspec would print them. A line
// consists of fixed texts and of holes between them, into which the numbers of a row are printed.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace fltea {

// A column of numbers, of shape (rows,) or (rows, width).
struct Cells {
    enum Kind { kReal, kWhole, kFlag };  // types of the numbers: double; int64; 0 or 1 in a byte

    const void* first;
    // distances in memory [bytes]: from a row to the next row, and within a row from a number to the next
    // number
    std::ptrdiff_t row, place;
    Kind kind;
};

class LinePrinter {
  public:
    struct Hole {
        std::size_t column, place;
    };

    // `texts`: the fixed texts of a line. The number of hole i is printed between texts i and i + 1. `nulls`:
    // if true, numbers that are not finite are printed as null; if false, they are omitted together with
    // their keys. Throws std::invalid_argument if the number of texts is not the number of holes plus one.
    LinePrinter(std::vector<std::string> texts, std::vector<Hole> holes, bool nulls)
        : texts_(std::move(texts)), holes_(std::move(holes)), nulls_(nulls) {
        if (texts_.size() != holes_.size() + 1)
            throw std::invalid_argument("a line must have one text more than it has numbers to print");
        for (const std::string& text : texts_) room_ += text.size() + kLongest;
    }

    const std::vector<Hole>& holes() const { return holes_; }
    bool uses(std::size_t column) const {
        return std::any_of(holes_.begin(), holes_.end(),
                           [&](const Hole& one) { return one.column == column; });
    }
    // Largest number of bytes that the text of `rows` rows can take.
    std::size_t room(std::size_t rows) const { return rows * room_; }

    // Prints the rows begin, begin + step, … below `end` into `out`, which must have room for as many bytes
    // as room() returns. Returns the end of the printed text. Each hole of the line says which number of a
    // row to print: the one at index `place` in the column `column`. These columns must have all rows to
    // print. Columns that no hole names are ignored.
    char* print(const Cells* columns, std::size_t begin, std::size_t end, std::size_t step, char* out) const {
        std::vector<Cell> cells;
        cells.reserve(holes_.size());
        for (const Hole& hole : holes_) {
            const Cells& one = columns[hole.column];
            const std::ptrdiff_t place = static_cast<std::ptrdiff_t>(hole.place) * one.place;
            cells.push_back({static_cast<const char*>(one.first) + place, one.row, one.kind});
        }
        for (std::size_t row = begin; row < end; row += step)
            out = print_row(cells, static_cast<std::ptrdiff_t>(row), out);
        return out;
    }

  private:
    // Largest number of characters of a number, including sign and exponent.
    static constexpr std::size_t kLongest = 32;

    struct Cell {
        const char* first;
        std::ptrdiff_t stride;
        Cells::Kind kind;
    };

    char* print_row(const std::vector<Cell>& cells, std::ptrdiff_t row, char* out) const {
        // whether all earlier keys of the present object were omitted, so that the next printed key is the
        // first
        bool first = false;
        for (std::size_t i = 0; i <= cells.size(); ++i) {
            const std::string& text = texts_[i];
            const std::size_t skipped = first && text.front() == ',' ? 1 : 0;
            out = std::copy(text.begin() + static_cast<std::ptrdiff_t>(skipped), text.end(), out);
            first = false;
            if (i == cells.size()) break;
            const char* const at = cells[i].first + row * cells[i].stride;
            if (cells[i].kind == Cells::kFlag) {
                out = put(*at ? "true" : "false", out);
            } else if (cells[i].kind == Cells::kWhole) {
                out = std::to_chars(out, out + kLongest, *reinterpret_cast<const std::int64_t*>(at)).ptr;
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

    // Prints a number with the fewest digits from which the same number can be read again. Like msgspec, it
    // uses an exponent only below 1e-5 and from 1e16 on.
    static char* put_real(double value, char* out) {
        char text[kLongest], digits[kLongest];
        const char* end = std::to_chars(text, text + kLongest, value, std::chars_format::scientific).ptr;
        const char* from = text;
        if (*from == '-') *out++ = *from++;
        int n = 0;
        for (; *from != 'e'; ++from)
            if (*from != '.') digits[n++] = *from;
        int exponent = 0;
        std::from_chars(from + (from[1] == '+' ? 2 : 1), end, exponent);
        const int whole = exponent + 1;  // number of digits before the decimal point
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

    static char* put(const char* word, char* out) { return std::copy(word, word + std::strlen(word), out); }

    std::vector<std::string> texts_;
    std::vector<Hole> holes_;
    bool nulls_;
    std::size_t room_ = 0;
};

}  // namespace fltea
