// Parses lines of text that are plain: each field to read is a number, empty, or a word such as NA for a
// missing value, and no field has quotes within it. The numbers are bit-identical to those of Python's
// float(). Python parses all other lines (host/fltea/recording/text_numbers.py), so that the rules for
// unusual lines exist only there.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string_view>
#include <system_error>
#include <vector>

namespace fltea {

// The form of a row of numbers. `separator`: character between its fields; 0 stands for white space. `least`:
// least number of fields. `most`: all fields after the first `most` ones have to be empty. `places`: indexes,
// counted from zero, of the fields to read.
struct RowForm {
    char separator;
    std::size_t least, most;
    std::vector<std::size_t> places;
};

class PlainRows {
  public:
    // `decimal`: the decimal mark of the numbers in earlier lines, '.' or ','; 0 if none of them had a
    // decimal mark. Where commas separate fields, a comma is never a decimal mark.
    PlainRows(RowForm form, char decimal) : form_(std::move(form)), decimal_(decimal) {
        for (std::size_t k = 0; k < form_.places.size(); ++k) {
            const std::size_t place = form_.places[k];
            if (slots_.size() <= place) slots_.resize(place + 1, kUnread);
            slots_[place] = slots_[place] == kUnread ? k : kTwice;
        }
    }

    static std::size_t lines_in(std::string_view text) {
        return 1 + static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
    }

    // Reads lines up to the first one that is not plain (not an ordinary row of numbers; see the top of this
    // file). All lines have to be complete; only the line end of the last one may be missing. Returns the
    // position at which the first line that is not plain begins, or text.size() + 1 if all lines are plain.
    // Blank lines and comments are skipped. The numbers are written to `values`, row by row. For each row,
    // the index of its line, counted from zero, is written to `lines`. Both arrays need room for all lines.
    std::size_t read(std::string_view text, double* values, std::int64_t* lines) {
        const std::size_t width = form_.places.size();
        std::size_t begin = 0;
        while (begin <= text.size()) {
            const void* const end =
                begin < text.size() ? std::memchr(&text[begin], '\n', text.size() - begin) : nullptr;
            const std::size_t stop =
                end ? static_cast<std::size_t>(static_cast<const char*>(end) - text.data()) : text.size();
            const std::string_view line = stripped(text.substr(begin, stop - begin), ends_line);
            if (!line.empty() && !is_for_people(line)) {
                double* const out = values + rows * width;
                if (!quick(line, out) && !row(line, out)) break;
                lines[rows++] = static_cast<std::int64_t>(passed);
            }
            ++passed;
            begin = stop + 1;
        }
        return begin;
    }

    // `passed`: number of lines that were read. `rows`: number of those lines that are rows of numbers.
    std::size_t passed = 0, rows = 0;

    char decimal() const { return decimal_; }

  private:
    static constexpr std::size_t kLongest = 64, kUnread = std::size_t(-1), kTwice = std::size_t(-2);

    static bool is_blank(char sign) { return sign == ' ' || (sign >= '\t' && sign <= '\r'); }
    static bool is_ascii(char sign) { return sign > ' ' && sign <= '~'; }
    static bool ends_line(char sign) { return sign == ' ' || sign == '\r'; }

    template <typename Marks>
    static std::string_view stripped(std::string_view text, Marks is_mark) {
        while (!text.empty() && is_mark(text.front())) text.remove_prefix(1);
        while (!text.empty() && is_mark(text.back())) text.remove_suffix(1);
        return text;
    }

    static bool is_for_people(std::string_view line) {
        if (!line.empty() && is_blank(line.front())) line = stripped(line, is_blank);
        return !line.empty() && (line.front() == '#' || line.front() == '%' || line.substr(0, 2) == "//");
    }

    // If all fields to be read are short numbers, does the same as row() in a third of the time. Otherwise
    // returns false.
    bool quick(std::string_view line, double* out) {
        if (!is_ascii(line.front()) || (decimal_ == ',' && form_.separator != ',')) return false;
        const char *at = line.data(), *const end = at + line.size();
        std::size_t fields = 0;
        bool has_point = false, is_plain = true;
        while (true) {
            const std::size_t slot = fields < slots_.size() ? slots_[fields] : kUnread;
            if (slot < kTwice) {
                at = digits(at, end, out[slot], has_point);
                is_plain = at && (at == end || is_end(*at));
            } else {
                is_plain = slot == kUnread;
                for (; is_plain && at != end && !is_end(*at); ++at) is_plain = is_ascii(*at) && *at != '"';
            }
            if (!is_plain) break;
            ++fields;
            if (at == end) break;
            ++at;
            while (!form_.separator && at != end && is_blank(*at)) ++at;
        }
        if (!is_plain || fields < form_.least || fields > form_.most || fields < slots_.size()) return false;
        if (has_point && form_.separator != ',') decimal_ = '.';
        return true;
    }

    bool is_end(char sign) const { return form_.separator ? sign == form_.separator : is_blank(sign); }

    // Returns whether a line is plain, which means an ordinary row of numbers (see the top of this file). If
    // it is, writes its numbers.
    bool row(std::string_view line, double* out) {
        fields_.clear();
        // a plain line may begin with a tab, but with no other control character and no character beyond
        // ASCII, because Python counts some of these as blanks
        bool plain = line.front() == '\t' || is_ascii(line.front());
        for (std::size_t begin = 0, end = 0; begin < line.size(); begin = form_.separator ? end + 1 : end) {
            if (form_.separator) {
                for (end = begin; end < line.size() && line[end] != form_.separator;) ++end;
            } else {
                while (begin < line.size() && is_blank(line[begin])) ++begin;
                if (begin == line.size()) break;
                for (end = begin; end < line.size() && !is_blank(line[end]); ++end)
                    plain &= is_ascii(line[end]);
            }
            plain &= add(line.substr(begin, end - begin));
        }
        if (form_.separator && line.back() == form_.separator) fields_.emplace_back();
        if (!plain || fields_.size() < form_.least) return false;
        for (std::size_t k = form_.most; k < fields_.size(); ++k)
            if (!fields_[k].empty()) return false;
        char mark = decimal_;
        for (const std::size_t place : form_.places) {
            double value = std::numeric_limits<double>::quiet_NaN();
            if (place < fields_.size() && !number(fields_[place], value, mark)) return false;
            *out++ = value;
        }
        decimal_ = mark;
        return true;
    }

    // Adds a field without the blanks and quotes around it. Returns false if the field has quotes anywhere
    // else.
    bool add(std::string_view field) {
        if (field.size() > 1 && field.front() == '"' && field.back() == '"')
            field = field.substr(1, field.size() - 2);
        fields_.push_back(stripped(field, is_blank));
        return field.find('"') == field.npos;
    }

    // Reads a field, and writes its number. Returns whether the field is a number, or empty, or a word that
    // marks a missing value.
    bool number(std::string_view text, double& value, char& mark) const {
        if (text.empty()) return true;
        if (text.size() >= kLongest) return false;
        char copy[kLongest];
        const std::size_t at = form_.separator == ',' ? text.npos : text.find_first_of(".,");
        if (at != text.npos) {
            if (mark && text[at] != mark) return false;
            mark = text[at];
        }
        if (at != text.npos && mark == ',') {
            if (at == 0 || !is_digit(text[at - 1]) || at + 1 == text.size() || !is_digit(text[at + 1]))
                return false;
            text.copy(copy, text.size());
            copy[at] = '.';
            text = {copy, text.size()};
        }
        const char *begin = text.data(), *const end = begin + text.size();
        bool has_point = false;
        if (digits(begin, end, value, has_point) == end) return true;
        if (*begin == '+' && (++begin == end || *begin == '-')) return false;
        const std::from_chars_result found = std::from_chars(begin, end, value);
        if (found.ec == std::errc() && found.ptr == end && end[-1] != ')') {
            if (std::isnan(value)) value = std::numeric_limits<double>::quiet_NaN();
            return true;
        }
        value = std::numeric_limits<double>::quiet_NaN();
        return is_missing(text);
    }

    static bool is_digit(char sign) { return sign >= '0' && sign <= '9'; }

    // Parses a short number. Its digits without the decimal mark have to be an integer of at most 2^53. This
    // integer is divided by an exact power of ten, so that this single division rounds correctly. Returns the
    // position after the number, or null if the text is not such a number.
    static const char* digits(const char* at, const char* end, double& value, bool& has_point) {
        static constexpr double kTens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8, 1e9,
                                           1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18};
        const bool is_negative = at != end && *at == '-';
        if (is_negative || (at != end && *at == '+')) ++at;
        const char *const first = at, *point = nullptr;
        std::uint64_t all = 0;
        for (; at != end; ++at) {
            if (is_digit(*at)) {
                all = all * 10 + static_cast<unsigned>(*at - '0');
            } else if (*at == '.' && !point) {
                point = at;
            } else {
                break;
            }
        }
        const std::ptrdiff_t count = at - first - (point ? 1 : 0);
        if (count == 0 || count > 18 || all > std::uint64_t{1} << 53) return nullptr;
        value = static_cast<double>(all) / kTens[point ? at - point - 1 : 0];
        if (is_negative) value = -value;
        has_point |= point != nullptr;
        return at;
    }

    static bool is_missing(std::string_view text) {
        for (const std::string_view word : {"na", "n/a", "null", "none"}) {
            std::size_t k = 0;
            while (k < word.size() && k < text.size() && (text[k] | 0x20) == (word[k] | 0x20)) ++k;
            if (k == word.size() && k == text.size()) return true;
        }
        return false;
    }

    RowForm form_;
    char decimal_;
    // for each field, the index in the row of results to which its number is written
    std::vector<std::size_t> slots_;
    std::vector<std::string_view> fields_;
};

}  // namespace fltea
