// The bins of a spectrum to which sentences are fitted: the columns that the kernels work on
// (sentence_kernel.hpp).
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "sentence_kernel.hpp"

namespace fltea {
namespace sentence {

struct Bins {
    const Kernel* kernel = nullptr;
    std::vector<double> counts, power, lam, square, cos1, sin1, ln_size, quarter, walk, spread, branch;
    double ordinates = 0, mean = 0, lowest = 0, log_h = 0;
    double lowest_order = 0, highest_order = kHighestOrder;

    Bins() = default;
    // `lam` rises from above 0 to π; `walk`: the spectrum of a walk of unit steps.
    Bins(const Kernel& used, std::vector<double> frequencies, std::vector<double> ordinates_of,
         std::vector<double> powers, std::vector<double> walks, double h)
        : kernel(&used),
          counts(std::move(ordinates_of)),
          power(std::move(powers)),
          lam(std::move(frequencies)),
          walk(std::move(walks)),
          log_h(std::log(h)) {
        for (std::size_t i = 0; i < size(); ++i) add(i);
        for (const int turns : {0, -1, 1})
            for (const double l : lam) branch.push_back(2 * std::log(std::fabs(2 * kPi * turns + l)));
        if (size()) lowest = lam[0];
        mean /= ordinates;
    }

    std::size_t size() const { return lam.size(); }
    Columns columns() const {
        return Columns{size(),        counts.data(), power.data(),   lam.data(),     square.data(),
                       cos1.data(),   sin1.data(),   ln_size.data(), quarter.data(), walk.data(),
                       spread.data(), branch.data(), log_h,          lowest_order,   highest_order};
    }

  private:
    void add(std::size_t i) {
        const double l = lam[i], half = std::sin(l / 2);
        square.push_back(4 * half * half);
        cos1.push_back(std::cos(l));
        sin1.push_back(std::sin(l));
        ln_size.push_back(std::log(2 * half));
        quarter.push_back((kPi - l) / 2);
        // Lines are taken to fill the space between neighbouring bins.
        const double reach = (lam[i + 1 < size() ? i + 1 : i] - lam[i ? i - 1 : 0]) / 4;
        spread.push_back(reach * reach / 3);
        ordinates += counts[i];
        mean += counts[i] * power[i];
    }
};

}  // namespace sentence
}  // namespace fltea
