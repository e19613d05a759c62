// Tests the parsing of plain rows of text (numbers between separators) under sanitizers.
// tests/recording/test_plain_rows.py tests the values.
#include <doctest/doctest.h>

#include <cmath>
#include <string>
#include <vector>

#include "noise.h"
#include "plain_rows.hpp"

using fltea::PlainRows;

TEST_CASE("plain rows: numbers, what is missing, blank lines and comments") {
    PlainRows rows({';', 2, 3, {1, 0, 2}}, '\0');
    const std::string text = "1,5;-2,25;\r\n\n# words\n \"7\";+3e2;NA\n1.5;2;3\n";
    std::vector<double> values(3 * PlainRows::lines_in(text));
    std::vector<std::int64_t> lines(PlainRows::lines_in(text));
    CHECK(rows.read(text, values.data(), lines.data()) == text.find("1.5;"));
    CHECK(rows.passed == 4);
    REQUIRE(rows.rows == 2);
    CHECK(lines[1] == 3);
    CHECK(rows.decimal() == ',');
    CHECK(values[0] == -2.25);
    CHECK(values[1] == 1.5);
    CHECK(std::isnan(values[2]));
    CHECK(values[3] == 300.0);
}

TEST_CASE("plain rows: of any bytes each line is passed once or stopped at") {
    const std::string marks = "0123456789..,,;; \t\r\n\n+-eE\"#/%naif\x01\x80\xff";
    Noise noise(7);
    for (int run = 0; run < 4000; ++run) {
        // The text is in a buffer of its exact size, so that a read beyond it is detected.
        std::vector<char> bytes(noise.below(60));
        for (char& one : bytes) one = marks[noise.below(marks.size())];
        const std::string_view text(bytes.data(), bytes.size());
        const char separators[] = {',', ';', '\t', '\0'};
        const char separator = separators[noise.below(4)];
        const std::size_t fields = 1 + noise.below(4);
        std::size_t at = 0, lines = 0;
        while (at <= text.size()) {
            PlainRows rows({separator, fields, fields + noise.below(2), {noise.below(fields)}}, '\0');
            const std::string_view rest = text.substr(at);
            std::vector<double> values(PlainRows::lines_in(rest));
            std::vector<std::int64_t> numbers(PlainRows::lines_in(rest));
            at += rows.read(rest, values.data(), numbers.data());
            lines += rows.passed;
            CHECK(rows.rows <= rows.passed);
            if (at > text.size()) break;
            const std::size_t end = text.find('\n', at);
            at = (end == text.npos ? text.size() : end) + 1;
            ++lines;
        }
        std::size_t ends = 1;
        for (const char one : bytes) ends += one == '\n';
        CHECK(lines == ends);
    }
}
