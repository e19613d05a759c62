// Reads the files with test vectors in protocol/vectors, which protocol/README.md describes under "Vectors".
#pragma once

#include <cstdint>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

typedef std::vector<uint8_t> Bytes;
// a record of a file with test vectors: key and value of each line
typedef std::vector<std::pair<std::string, std::string>> Record;

// Returns the lines of a file except comments. Throws if there are no lines, so that a test with a wrong path
// cannot pass.
inline std::vector<std::string> vector_lines(const std::string& name) {
    std::ifstream file(std::string(VECTORS) + "/" + name);
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) {
        if (line.empty() || line[0] != '#') lines.push_back(line);
    }
    if (lines.empty()) throw std::runtime_error("no lines in " + name);
    return lines;
}

// Reads hexadecimal bytes without blanks, such as "a0b1".
inline Bytes from_hex(const std::string& text) {
    Bytes bytes;
    for (size_t i = 0; i + 1 < text.size(); i += 2) {
        bytes.push_back(static_cast<uint8_t>(std::stoul(text.substr(i, 2), nullptr, 16)));
    }
    return bytes;
}

// Reads bytes and ranges of bytes, such as "A0 01..FE"; "-" stands for no bytes.
inline Bytes from_runs(const std::string& text) {
    std::istringstream words(text);
    Bytes bytes;
    for (std::string word; words >> word;) {
        if (word == "-") continue;
        unsigned long first = std::stoul(word.substr(0, 2), nullptr, 16);
        unsigned long last = word.size() > 2 ? std::stoul(word.substr(4), nullptr, 16) : first;
        for (; first <= last; ++first) bytes.push_back(static_cast<uint8_t>(first));
    }
    return bytes;
}

// Reads a file of rows "left | right".
inline std::vector<std::pair<std::string, std::string>> table(const std::string& name) {
    std::vector<std::pair<std::string, std::string>> rows;
    for (const std::string& line : vector_lines(name)) {
        size_t bar = line.find('|');
        if (bar != std::string::npos) rows.push_back({line.substr(0, bar), line.substr(bar + 1)});
    }
    return rows;
}

// Reads a file of records: blocks of lines "key value", separated by blank lines.
inline std::vector<Record> records(const std::string& name) {
    std::vector<Record> found(1);
    for (const std::string& line : vector_lines(name)) {
        if (line.empty()) {
            if (!found.back().empty()) found.push_back(Record());
            continue;
        }
        size_t blank = line.find(' ');
        found.back().push_back(
            {line.substr(0, blank), blank == std::string::npos ? "" : line.substr(blank + 1)});
    }
    return found;
}

inline std::string value_of(const Record& record, const std::string& key) {
    for (const std::pair<std::string, std::string>& line : record) {
        if (line.first == key) return line.second;
    }
    throw std::runtime_error("no " + key + " in a record");
}
