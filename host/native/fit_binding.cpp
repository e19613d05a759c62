// Whittle fits for Python, on plain arrays (host/fltea/spectrum/whittle.py).
#include "fit_binding.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <optional>
#include <string>

#include "whittle_profile.hpp"

namespace nb = nanobind;

namespace {

using fltea::whittle::Family;
using fltea::whittle::Grid;
using fltea::whittle::Kernel;
using fltea::whittle::Model;
using fltea::whittle::Point;
using fltea::whittle::Spectra;

using Column = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Points = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Groups = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutColumn = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutPoints = nb::ndarray<double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using OutRows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Groups whose best point is a start: local minima are real, α = 0 and α = 1 are the same for a g each.
constexpr std::size_t kKept = 6;
constexpr int kColdSteps = 60;
constexpr int kWarmSteps = 10;
// Powers beyond this, or below one over it, would leave the range of doubles.
constexpr double kLargest = 1e100;

[[noreturn]] void refuse(const std::string& why) { throw nb::value_error(why.c_str()); }

const Kernel& fastest() {
#if defined(FLTEA_X86)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))
            return fltea::whittle::kernel_avx512;
        return fltea::whittle::kernel_avx2;
    }
#endif
    return fltea::whittle::kernel_baseline;
}

// The data of a fit; ValueError for those that no spectrum can be fitted to.
class Data {
  public:
    Data(Column lam, Column counts, Rows power) : spectra_(checked(lam, counts, power)) {}
    const Spectra& operator*() const { return spectra_; }
    const Spectra* operator->() const { return &spectra_; }

  private:
    static Spectra checked(const Column& lam, const Column& counts, const Rows& power) {
        const size_t bins = lam.shape(0), series = power.shape(0);
        if (counts.shape(0) != bins || power.shape(1) != bins)
            refuse("lam, counts and each row of power must have one number a bin");
        if (bins < 2)
            refuse("a spectrum of " + std::to_string(bins) + " bins says nothing: 2 or more are needed");
        double ordinates = 0;
        for (size_t i = 0; i < bins; ++i) {
            const double l = lam.data()[i], count = counts.data()[i];
            if (!(l > (i ? lam.data()[i - 1] : 0.0) && l <= 3.1415926535897936))
                refuse("lam must rise, above 0 and up to pi rad a sample");
            if (!(count >= 0 && count <= kLargest)) refuse("counts must be finite numbers, 0 or more");
            ordinates += count;
        }
        if (!(ordinates > 0)) refuse("all counts are 0: there is nothing to fit");
        for (size_t s = 0; s < series; ++s) {
            double sum = 0;
            for (size_t i = 0; i < bins; ++i) {
                const double p = power.data()[s * bins + i];
                if (!(p >= 0 && p <= kLargest)) refuse("power must be finite numbers, 0 or more");
                sum += p * counts.data()[i];
            }
            if (!(sum / ordinates >= 1 / kLargest)) refuse("the power is 0: there is no noise in it");
        }
        return Spectra(lam.data(), counts.data(), power.data(), bins, series);
    }
    Spectra spectra_;
};

// hold: enum Hold, with the value that is held; h is the sampling period in s.
Model<double> model_of(int family, double highest_order, int hold, double held, double h) {
    using namespace fltea::whittle;
    if (family < 0 || family >= kFamilies) refuse("no such model");
    if (!(highest_order > 0 && highest_order <= 2)) refuse("orders are fitted up to 2");
    const Family of = static_cast<Family>(family);
    if (hold < kNothing || hold > kHoldNoise || (hold != kNothing && of != kFractional))
        refuse("only one number of the fractional model can be held");
    if (!std::isfinite(held) || !(std::isfinite(h) && h > 0))
        refuse("a held number and h must be finite, and h > 0");
    const bool negative = hold == kHoldFeedback || hold == kHoldParameter;
    if (negative && !(held < 0)) refuse("g and f can be held below 0 only");
    if (hold == kHoldOrder && !(held >= 0 && held < 2)) refuse("orders can be held from 0 to below 2");
    if ((hold == kHoldState || hold == kHoldNoise) && !(held > 0))
        refuse("variances can be held above 0 only");
    return Model<double>{of, highest_order, static_cast<Hold>(hold), held, std::log(h), 0};
}

void check_finite(const double* values, size_t count) {
    for (size_t i = 0; i < count; ++i)
        if (!std::isfinite(values[i])) refuse("starts must be finite numbers");
}

// The best of each series: theta (series, p), scale and nll (series,) are filled in.
void fit(Column lam, Column counts, Rows power, int family, double highest_order, int hold, double held,
         double h, Rows starts, Groups groups, std::optional<Points> extra, std::optional<Rows> warm,
         OutRows theta, OutColumn scale, OutColumn nll) {
    const Model<double> model = model_of(family, highest_order, hold, held, h);
    const size_t free = static_cast<size_t>(free_of(model)), series = power.shape(0);
    if (starts.shape(1) != free || starts.shape(0) != groups.shape(0) || starts.shape(0) == 0 ||
        theta.shape(0) != series || theta.shape(1) != free || scale.shape(0) != series ||
        nll.shape(0) != series || (extra && (extra->shape(0) != series || extra->shape(2) != free)) ||
        (warm && (warm->shape(0) != series || warm->shape(1) != free))) {
        refuse("starts must have shape (k, p), extra_starts (series, k, p) and warm (series, p)");
    }
    size_t last = 0;
    for (size_t i = 0; i < groups.shape(0); ++i) {
        const int64_t group = groups.data()[i];
        if (group < 0 || group >= static_cast<int64_t>(groups.shape(0)))
            refuse("groups are numbers from 0 on");
        last = std::max(last, static_cast<size_t>(group));
    }
    check_finite(starts.data(), starts.size());
    if (extra) check_finite(extra->data(), extra->size());
    if (warm) check_finite(warm->data(), warm->size());
    const Data data(lam, counts, power);
    const nb::gil_scoped_release release;
    const Kernel& kernel = fastest();
    const Grid grid = {starts.data(), groups.data(), starts.shape(0), last + 1};
    std::vector<size_t> begin;
    if (!warm) begin = best_starts(kernel, *data, model, grid, kKept);
    const int steps = warm ? kWarmSteps : kColdSteps;
    for (size_t s = 0; s < series; ++s) {
        const auto target = data->target(kernel, s);
        Point<double> best = Point<double>();
        best.nll = fltea::whittle::kImpossible;
        const auto from = [&](const double* start) { try_start(target, model, start, steps, best); };
        if (warm) {
            from(warm->data() + s * free);
        } else {
            for (size_t k = 0; k < kKept; ++k) {
                const size_t at = begin[s * kKept + k];
                if (k == 0 || at != begin[s * kKept + k - 1]) from(starts.data() + at * free);
            }
        }
        const size_t extras = extra ? extra->shape(1) : 0;
        for (size_t k = 0; k < extras; ++k) from(extra->data() + (s * extras + k) * free);
        std::copy(best.theta, best.theta + free, theta.data() + s * free);
        scale.data()[s] = best.scale;
        nll.data()[s] = best.nll;
    }
}

// -log L of each series at theta (series, p) and its slopes: nll (series,), gradient (series, p) and the
// expected curvature, information (series, p, p), are filled in.
void slopes(Column lam, Column counts, Rows power, int family, double highest_order, int hold, double held,
            double h, Rows theta, OutColumn nll, OutRows gradient, OutPoints information) {
    const Model<double> model = model_of(family, highest_order, hold, held, h);
    const size_t free = static_cast<size_t>(free_of(model)), series = power.shape(0);
    if (theta.shape(0) != series || theta.shape(1) != free || nll.shape(0) != series ||
        gradient.shape(0) != series || gradient.shape(1) != free || information.shape(0) != series ||
        information.shape(1) != free || information.shape(2) != free) {
        refuse("theta must have shape (series, p)");
    }
    check_finite(theta.data(), theta.size());
    const Data data(lam, counts, power);
    for (size_t s = 0; s < series; ++s) {
        Point<double> point = Point<double>();
        std::copy(theta.data() + s * free, theta.data() + (s + 1) * free, point.theta);
        canonical(model, point.theta);
        evaluate(data->target(fastest(), s), model, point);
        nll.data()[s] = point.nll;
        for (size_t i = 0; i < free; ++i) {
            gradient.data()[s * free + i] = point.gradient[i];
            for (size_t j = 0; j < free; ++j)
                information.data()[(s * free + i) * free + j] = point.fisher[i][j];
        }
    }
}

// Ends of intervals of the fractional model's numbers: rows of `what` are hold, logarithm (0 or 1), here, low
// and high, and both critical values (Profiled); rows of `ends` low and high, and so those of `near`, of an
// earlier search, if given.
void intervals(Column lam, Column counts, Rows power, Column theta, double scale, double nll, double h,
               Rows what, std::optional<Rows> near, OutRows ends) {
    using namespace fltea::whittle;
    if (power.shape(0) != 1 || theta.shape(0) != 3 || what.shape(1) != 7 || ends.shape(0) != what.shape(0) ||
        ends.shape(1) != 2 || (near && (near->shape(0) != what.shape(0) || near->shape(1) != 2))) {
        refuse("one series, a fit of the fractional model, and rows of 7 and 2 numbers are needed");
    }
    if (near) check_finite(near->data(), near->size());
    check_finite(theta.data(), theta.size());
    check_finite(what.data(), what.size());
    if (!(std::isfinite(nll) && scale > 0 && scale <= kLargest && std::isfinite(h) && h > 0))
        refuse("the fit must be finite, and h > 0");
    std::vector<Profiled> profiled;
    for (size_t i = 0; i < what.shape(0); ++i) {
        const double* const row = what.data() + 7 * i;
        if (!(row[0] >= kHoldOrder && row[0] <= kHoldNoise) ||
            !(row[3] < row[4] && row[2] >= row[3] && row[2] <= row[4]) || !(row[5] > 0 && row[6] > 0))
            refuse("no such profile");
        profiled.push_back({static_cast<Hold>(static_cast<int>(row[0])),
                            row[1] != 0,
                            row[2],
                            row[3],
                            row[4],
                            {row[5], row[6]}});
    }
    const Data data(lam, counts, power);
    const nb::gil_scoped_release release;
    Profile profile(fastest(), *data, theta.data(), scale, nll, h);
    std::vector<Ends> found(profiled.size()), before;
    for (size_t i = 0; near && i < found.size(); ++i)
        before.push_back(Ends{near->data()[2 * i], near->data()[2 * i + 1]});
    profile.ends(profiled.data(), profiled.size(), found.data(), near ? before.data() : nullptr);
    for (size_t i = 0; i < found.size(); ++i) {
        ends.data()[2 * i] = found[i].low;
        ends.data()[2 * i + 1] = found[i].high;
    }
}

}  // namespace

void bind_fit(nb::module_& m) {
    m.def("whittle_fit", &fit, nb::arg("lam"), nb::arg("counts"), nb::arg("power"), nb::arg("family"),
          nb::arg("highest_order"), nb::arg("hold"), nb::arg("held"), nb::arg("h"), nb::arg("starts"),
          nb::arg("groups"), nb::arg("extra").none(), nb::arg("warm").none(), nb::arg("theta"),
          nb::arg("scale"), nb::arg("nll"));
    m.def("whittle_slopes", &slopes, nb::arg("lam"), nb::arg("counts"), nb::arg("power"), nb::arg("family"),
          nb::arg("highest_order"), nb::arg("hold"), nb::arg("held"), nb::arg("h"), nb::arg("theta"),
          nb::arg("nll"), nb::arg("gradient"), nb::arg("information"));
    m.def("whittle_intervals", &intervals, nb::arg("lam"), nb::arg("counts"), nb::arg("power"),
          nb::arg("theta"), nb::arg("scale"), nb::arg("nll"), nb::arg("h"), nb::arg("what"),
          nb::arg("near").none(), nb::arg("ends"));
}
