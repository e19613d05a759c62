// A fitted noise model of a spectrum: its parts, white noise first, with their transformed free parameters.
#pragma once

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "sentence_fit.hpp"

namespace fltea {
namespace sentence {

struct Sentence {
    Words words;
    std::vector<double> eta;
    double nll = std::numeric_limits<double>::infinity();

    Sentence() = default;
    Sentence(Words what, std::vector<double> at, double minus_log)
        : words(std::move(what)), eta(std::move(at)), nll(minus_log) {}

    bool known() const { return !words.empty(); }
    bool has(Part part) const { return count(part) > 0; }
    int count(Part part) const {
        return static_cast<int>(std::count_if(words.begin(), words.end(),
                                              [part](const Word& word) { return word.part == part; }));
    }
    bool filtered() const {
        return std::any_of(words.begin(), words.end(), [](const Word& word) { return filters(word.part); });
    }
    bool same_words(const Sentence& other) const {
        if (words.size() != other.words.size()) return false;
        for (std::size_t i = 0; i < words.size(); ++i)
            if (words[i].part != other.words[i].part || words[i].size != other.words[i].size) return false;
        return true;
    }
    // The number of parameters that BIC counts.
    int parameters() const {
        int found = free_of(words);
        for (const Word& word : words) found += row_of(word.part).sought;
        return found;
    }
};

}  // namespace sentence
}  // namespace fltea
