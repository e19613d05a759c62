// One spectrum to fit, in double: its sums are those of a kernel.
#pragma once

#include "whittle_kernel.hpp"
#include "whittle_scoring.hpp"

namespace fltea {
namespace whittle {

struct Target {
    typedef double Number;

    const Kernel* kernel;
    const Bins* bins;
    const double* power;
    double ordinates;

    void sums(Family family, const Natural<double>& at, Sums<double>& out) const {
        kernel->sums(family, *bins, power, at, out);
    }
    // -log L of a spectrum with these sums, at the best scale where it is free.
    double nll(const Sums<double>& sums, double scale, bool free_scale) const {
        return free_scale ? sums.log_spectrum + ordinates * math::log(scale) + ordinates
                          : sums.log_spectrum + sums.ratio;
    }
};

const double kImpossible = Room<double>::impossible();

}  // namespace whittle
}  // namespace fltea
