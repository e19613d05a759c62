// A noise model that was fitted to a spectrum: its noise parts, white noise first, and the values of their
// free parameters.
#pragma once

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "whittle_fit.hpp"

namespace fltea {
namespace noise_models {

struct FittedModel {
    Terms terms;
    std::vector<double> eta;
    double nll = std::numeric_limits<double>::infinity();

    FittedModel() = default;
    FittedModel(Terms what, std::vector<double> at, double minus_log)
        : terms(std::move(what)), eta(std::move(at)), nll(minus_log) {}

    bool known() const { return !terms.empty(); }
    bool has(Part part) const { return count(part) > 0; }
    int count(Part part) const {
        return static_cast<int>(std::count_if(terms.begin(), terms.end(),
                                              [part](const Term& term) { return term.part == part; }));
    }
    bool filtered() const {
        return std::any_of(terms.begin(), terms.end(), [](const Term& term) { return filters(term.part); });
    }
    bool same_terms(const FittedModel& other) const {
        if (terms.size() != other.terms.size()) return false;
        for (std::size_t i = 0; i < terms.size(); ++i)
            if (terms[i].part != other.terms[i].part || terms[i].size != other.terms[i].size) return false;
        return true;
    }
    // Number of parameters as the criterion BIC counts them: those that a fit changes, and those of which a
    // search tries many values.
    int parameters() const {
        int found = free_of(terms);
        for (const Term& term : terms) found += row_of(term.part).sought;
        return found;
    }
};

}  // namespace noise_models
}  // namespace fltea
