// Makes fits of noise models available in Python (host/fltea/spectrum/candidate_models.py). Python passes the
// bins of a spectrum once, and can then fit any number of models to them.
#include "whittle_binding.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "engine_binding.hpp"
#include "whittle_interval.hpp"
#include "whittle_search.hpp"

namespace nb = nanobind;

namespace {

using namespace fltea::noise_models;
using Column = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using OutColumn = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutRows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr double kLargestPower = 1e100;
// for Python, the number kMeanFrom + m stands for the noise part "mean of m samples"
constexpr int kMeanFrom = 100;

const Kernel& fastest() {
#if defined(FLTEA_X86)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return kernel_avx512;
        return kernel_avx2;
    }
#endif
    return kernel_baseline;
}

[[noreturn]] void refuse(const std::string& why) { throw nb::value_error(why.c_str()); }

Terms terms_of(const std::vector<int>& codes) {
    Terms terms;
    for (const int code : codes) {
        if (code < 0 || (code >= kParts && code < kMeanFrom) || code > kMeanFrom + 64 || code == kMean)
            refuse("no such part: " + std::to_string(code));
        terms.push_back(code >= kMeanFrom ? Term{kMean, code - kMeanFrom} : Term{static_cast<Part>(code), 0});
    }
    if (terms.empty() || terms[0].part != kWhite) refuse("a noise model begins with white noise");
    if (free_of(terms) > kMostFree)
        refuse("a noise model has at most " + std::to_string(kMostFree) + " parameters");
    return terms;
}

// A noise model for Python: the identifiers of the model's noise parts, the values of their parameters, and
// -log L. An empty list of parts means that there is no model.
using Raw = std::tuple<std::vector<int>, std::vector<double>, double>;

Raw raw_of(const FittedModel& s) {
    std::vector<int> codes;
    for (const Term& term : s.terms) codes.push_back(term.part == kMean ? kMeanFrom + term.size : term.part);
    return {codes, s.eta, s.nll};
}

void check(const Terms& terms, const std::vector<double>& eta) {
    if (eta.size() != static_cast<std::size_t>(free_of(terms)))
        refuse("eta must have one number for each parameter");
    for (const double value : eta)
        if (!std::isfinite(value)) refuse("parameters must be finite numbers");
}

class Fitted {
  public:
    Fitted(Column lam, Column counts, Column power, Column walk, Column window, double h) {
        const std::size_t size = lam.shape(0);
        if (counts.shape(0) != size || power.shape(0) != size || walk.shape(0) != size ||
            window.shape(0) != size)
            refuse("lam, counts, power, walk and window must have one number for each bin");
        if (size < 2)
            refuse("a spectrum of " + std::to_string(size) + " bins says nothing: 2 or more are needed");
        double before = 0, ordinates = 0, sum = 0;
        for (std::size_t i = 0; i < size; ++i) {
            const double l = lam.data()[i], count = counts.data()[i], p = power.data()[i];
            if (!(l > before && l <= kPi + 1e-12))
                refuse("lam must increase, and be above 0 and at most pi rad per sample");
            if (!(count >= 0 && count <= kLargestPower)) refuse("counts must be finite numbers, 0 or more");
            if (!(p >= 0 && p <= kLargestPower)) refuse("power must be finite numbers, 0 or more");
            if (!(walk.data()[i] >= 0 && std::isfinite(walk.data()[i])))
                refuse("walk must be finite numbers");
            if (!(window.data()[i] >= 0 && window.data()[i] <= kPi * kPi))
                refuse("window must be mean squares of frequencies");
            before = l;
            ordinates += count;
            sum += count * p;
        }
        if (!(ordinates > 0)) refuse("all counts are 0: there is nothing to fit");
        if (!(sum / ordinates >= 1 / kLargestPower)) refuse("the power is 0: there is no noise in it");
        if (!(std::isfinite(h) && h > 0)) refuse("h must be finite and above 0");
        const auto column = [size](const Column& one) { return Numbers(one.data(), one.data() + size); };
        bins_ = Bins(fastest(), column(lam), column(counts), column(power), column(walk), column(window), h);
    }

    std::pair<std::vector<double>, double> fit(const std::vector<int>& codes, std::vector<double> eta,
                                               int held, int steps, double converged, double slowest,
                                               double lowest_order, double highest_order) {
        const Terms terms = terms_of(codes);
        check(terms, eta);
        if (!(lowest_order >= 0 && lowest_order < highest_order && highest_order <= kHighestOrder))
            refuse("orders are fitted from 0 up to 2");
        const nb::gil_scoped_release release;
        set_orders(lowest_order, highest_order);
        const double nll = score(bins_, terms, eta.data(), held, Patience{steps, converged, slowest});
        return {std::move(eta), nll};
    }

    // Returns the seven models that a search finds, in the order white, null, plain, rich, pure, ordered,
    // missing (explained in CandidateModels of host/fltea/spectrum/candidate_models.py). `last`: these seven
    // models from an earlier search, which are only fitted again to the present bins; empty for a new search.
    std::vector<Raw> search(const std::vector<Raw>& last) {
        std::vector<FittedModel> before;
        for (const Raw& one : last) {
            FittedModel s;
            if (!std::get<0>(one).empty()) {
                s.terms = terms_of(std::get<0>(one));
                s.eta = std::get<1>(one);
                check(s.terms, s.eta);
            }
            before.push_back(s);
        }
        if (!before.empty() && before.size() != 7) refuse("there are seven candidate models");
        const nb::gil_scoped_release release;
        Search search(bins_);
        const Frontier f = before.empty() ? search.whole()
                                          : search.again(Frontier{before[0], before[1], before[2], before[3],
                                                                  before[4], before[5], before[6]});
        return {raw_of(f.white), raw_of(f.null),    raw_of(f.plain),  raw_of(f.rich),
                raw_of(f.pure),  raw_of(f.ordered), raw_of(f.missing)};
    }

    // The null test compares white noise with an order and with a high-pass. Returns by how much the 2 log L
    // of each of these two exceeds that of white noise, and then the free parameters of both. `last`: the
    // free parameters of both from an earlier test, or empty.
    std::tuple<double, double, std::vector<double>> null_test(const std::vector<double>& last) {
        if (!last.empty() && last.size() != NullFits::kOrderFree + 3)
            refuse(
                "a null test has seven free parameters: four of an order and three of a high-pass, each in "
                "white noise");
        for (const double value : last)
            if (!std::isfinite(value)) refuse("parameters must be finite numbers");
        const nb::gil_scoped_release release;
        const NullTest found = fltea::noise_models::null_test(bins_, last);
        std::vector<double> eta = found.order.eta;
        eta.insert(eta.end(), found.missing.eta.begin(), found.missing.eta.end());
        return {2 * (found.white.nll - found.order.nll), 2 * (found.white.nll - found.missing.nll), eta};
    }

    // Returns the end of a parameter's interval as interval_end() finds it, or NaN if the interval has no
    // end. Also returns all parameters at that end minus the best parameters. `last`: these differences from
    // an earlier fit, or empty.
    std::pair<double, std::vector<double>> end(const std::vector<int>& codes, const std::vector<double>& eta,
                                               double nll, int index, int side, double limit, double step,
                                               double usual, double at_bound, std::vector<double> last) {
        const Terms terms = terms_of(codes);
        check(terms, eta);
        if (!last.empty()) check(terms, last);
        const int free = free_of(terms);
        if (index < 0 || index >= free || !(step > 0) || (side != 1 && side != -1) || !std::isfinite(limit))
            refuse("no such parameter, or no such end");
        const nb::gil_scoped_release release;
        set_orders(0, kHighestOrder);
        const Patience patience{60, 1e-5, kSlowest};
        const double found = interval_end(bins_, terms, eta, nll, index, side, limit, step,
                                          Critical{usual, at_bound}, patience, last);
        return {found, std::move(last)};
    }

    // Writes the spectrum of a model to `total`. Writes the derivatives of the spectrum's logarithm by the
    // parameters to `rows`, one row for each parameter.
    void slopes(const std::vector<int>& codes, const std::vector<double>& eta, OutColumn total,
                OutRows rows) {
        const Terms terms = terms_of(codes);
        check(terms, eta);
        if (total.shape(0) != bins_.size() || rows.shape(1) != bins_.size() || rows.shape(0) != eta.size())
            refuse("total must have one number for each bin, and rows one row for each parameter");
        set_orders(0, kHighestOrder);
        Spectrum here(bins_);
        here.at(terms, eta.data());
        std::copy(here.total().begin(), here.total().end(), total.data());
        for (std::size_t k = 0; k < eta.size(); ++k) {
            const double* const row = here.slope(static_cast<int>(k));
            std::copy(row, row + bins_.size(), rows.data() + k * bins_.size());
        }
    }

  private:
    // Correlation times are tried up to this many times the longest one that the spectrum can show.
    static constexpr double kSlowest = 300;

    void set_orders(double lowest, double highest) {
        bins_.lowest_order = lowest;
        bins_.highest_order = highest;
    }
    Bins bins_;
};

// Returns the table of noise parts for Python, in the order of the enumeration Part. A row has five columns:
// the part's name; its free parameters, each with kind of value, lowest and highest value; its traits; the
// question of the verdict that the part answers; and the number of further parameters of which a search tries
// many values.
using RawParameter = std::tuple<std::string, double, double>;
using RawRow = std::tuple<std::string, std::vector<RawParameter>, std::vector<std::string>, std::string, int>;

std::vector<RawRow> noise_parts() {
    std::vector<RawRow> found;
    for (const Row& row : kTable) {
        std::vector<RawParameter> free_parameters;
        for (int k = 0; k < row.free_parameters.count; ++k) {
            const FreeParameter& one = row.free_parameters.at[k];
            free_parameters.emplace_back(name_of(one.value), one.low, one.high);
        }
        std::vector<std::string> traits;
        for (unsigned bit = 1; bit <= row.traits; bit <<= 1)
            if (row.is(bit)) traits.emplace_back(name_of(static_cast<Trait>(bit)));
        found.emplace_back(row.name, free_parameters, traits, name_of(row.says), row.sought);
    }
    return found;
}

// Writes the spectrum of a model at the frequencies `lam` [rad per sample] to `total`.
void spectrum(const std::vector<int>& codes, const std::vector<double>& eta, Column lam, double h,
              OutColumn total) {
    const Terms terms = terms_of(codes);
    check(terms, eta);
    if (total.shape(0) != lam.shape(0)) refuse("total must have one number a frequency");
    const std::size_t size = lam.shape(0);
    const LockGivenAway given(size);
    unsigned read = 0;
    for (const Term& term : terms) read |= row_of(term.part).columns;
    const Bins bins(fastest(), Numbers(lam.data(), lam.data() + size), read, h);
    Spectrum here(bins);
    here.at(terms, eta.data());
    std::copy(here.total().begin(), here.total().end(), total.data());
}

}  // namespace

void bind_whittle_fits(nb::module_& m) {
    nb::class_<Fitted>(m, "WhittleFits")
        .def(nb::init<Column, Column, Column, Column, Column, double>(), nb::arg("lam"), nb::arg("counts"),
             nb::arg("power"), nb::arg("walk"), nb::arg("window"), nb::arg("h"))
        .def("fit", &Fitted::fit, nb::arg("codes"), nb::arg("eta"), nb::arg("held") = -1,
             nb::arg("steps") = 60, nb::arg("converged") = 1e-5, nb::arg("slowest") = 1.0,
             nb::arg("lowest_order") = 0.0, nb::arg("highest_order") = kHighestOrder)
        .def("search", &Fitted::search, nb::arg("last"))
        .def("null_test", &Fitted::null_test, nb::arg("last"))
        .def("end", &Fitted::end, nb::arg("codes"), nb::arg("eta"), nb::arg("nll"), nb::arg("index"),
             nb::arg("side"), nb::arg("limit"), nb::arg("step"), nb::arg("usual"), nb::arg("at_bound"),
             nb::arg("last"))
        .def("slopes", &Fitted::slopes, nb::arg("codes"), nb::arg("eta"), nb::arg("total"), nb::arg("rows"));
    m.attr("MEAN_FROM") = kMeanFrom;
    m.def("noise_parts", &noise_parts);
    m.def("model_spectrum", &spectrum, nb::arg("codes"), nb::arg("eta"), nb::arg("lam"), nb::arg("h"),
          nb::arg("total"));
}
