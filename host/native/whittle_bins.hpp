// The bins of a spectrum to which noise models are fitted, as the columns of numbers that the kernels read
// (whittle_kernel.hpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <new>
#include <utility>
#include <vector>

#include "whittle_kernel.hpp"

namespace fltea {
namespace noise_models {

// Allocates memory that begins at a cache line. A pack of numbers that extends over two cache lines takes
// twice as long to write. C++11 cannot allocate memory with such an alignment. A larger piece is therefore
// allocated, and the address of this piece is stored in front of the memory that is used.
template <class T>
struct OnLines {
    typedef T value_type;
    static constexpr std::size_t kLine = 64;

    OnLines() = default;
    template <class U>
    OnLines(const OnLines<U>&) {}
    T* allocate(std::size_t n) {
        void* const given = ::operator new(n * sizeof(T) + kLine + sizeof given);
        const std::uintptr_t first = reinterpret_cast<std::uintptr_t>(given) + sizeof given;
        void** const found = reinterpret_cast<void**>((first + kLine - 1) / kLine * kLine);
        found[-1] = given;
        return reinterpret_cast<T*>(found);
    }
    void deallocate(T* at, std::size_t) { ::operator delete(reinterpret_cast<void**>(at)[-1]); }
    friend bool operator==(OnLines, OnLines) { return true; }
    friend bool operator!=(OnLines, OnLines) { return false; }
};
typedef std::vector<double, OnLines<double>> Numbers;

// For rows of `size` numbers each, returns the distance between the beginnings of consecutive rows, counted
// in numbers. The distance is a whole number of cache lines.
inline std::size_t stride_of(std::size_t size) {
    constexpr std::size_t kStep = OnLines<double>::kLine / sizeof(double);
    return (size + kStep - 1) / kStep * kStep;
}

struct Bins {
    const Kernel* kernel = nullptr;
    Numbers counts, power, lam, square, cos1, sin1, ln_size, quarter, walk, spread, branch;
    double ordinates = 0, mean = 0, lowest = 0, log_h = 0;
    double lowest_order = 0, highest_order = kHighestOrder;

    Bins() = default;
    // `frequencies`: above 0, rising, at most π. `walks`: at each frequency, the spectrum of a random walk
    // whose steps have the variance 1. `windows`: Because of the window of the Fourier transform, the power
    // of a bin comes from a range of frequencies. This is their mean square distance from the bin's own
    // frequency [rad²].
    Bins(const Kernel& used, Numbers frequencies, Numbers ordinates_of, Numbers powers, Numbers walks,
         const Numbers& windows, double h)
        : kernel(&used),
          counts(std::move(ordinates_of)),
          power(std::move(powers)),
          lam(std::move(frequencies)),
          walk(std::move(walks)),
          log_h(std::log(h)) {
        fill(kAllColumns);
        for (std::size_t i = 0; i < size(); ++i) spread[i] += windows[i];
        for (std::size_t i = 0; i < size(); ++i) {
            ordinates += counts[i];
            mean += counts[i] * power[i];
        }
        if (size()) lowest = lam[0];
        mean /= ordinates;
    }
    // Makes bins at arbitrary frequencies that have no data, for computing the spectrum of noise parts.
    // `read` selects which functions of the frequency are computed (enum Read); the parts must need no
    // others.
    Bins(const Kernel& used, Numbers frequencies, unsigned read, double h)
        : kernel(&used),
          counts(frequencies.size()),
          power(frequencies.size()),
          lam(std::move(frequencies)),
          log_h(std::log(h)) {
        fill(read);
        for (const double one : square) walk.push_back(1 / one);
    }

    std::size_t size() const { return lam.size(); }
    Columns columns() const {
        return Columns{size(),        counts.data(), power.data(),   lam.data(),     square.data(),
                       cos1.data(),   sin1.data(),   ln_size.data(), quarter.data(), walk.data(),
                       spread.data(), branch.data(), log_h,          lowest_order,   highest_order};
    }

  private:
    void fill(unsigned read) {
        for (std::size_t i = 0; i < size(); ++i) {
            quarter.push_back((kPi - lam[i]) / 2);
            // Each bin is assumed to extend half of the way to its neighbours.
            const double reach = (lam[i + 1 < size() ? i + 1 : i] - lam[i ? i - 1 : 0]) / 4;
            spread.push_back(reach * reach / 3);
        }
        for (const double l : lam) {
            const double half = read & (kSquare | kLogSize) ? std::sin(l / 2) : 0.0;
            if (read & kSquare) square.push_back(4 * half * half);
            if (read & kLogSize) ln_size.push_back(std::log(2 * half));
            if (read & kTurn) {
                cos1.push_back(std::cos(l));
                sin1.push_back(std::sin(l));
            }
        }
        for (const int turns : {0, -1, 1})
            for (const double l : lam)
                if (read & kBranch) branch.push_back(2 * std::log(std::fabs(2 * kPi * turns + l)));
    }
};

// Returns the median power of the highest tenth of the bins, or of the lowest tenth.
inline double end_power(const Bins& bins, bool highest) {
    const std::size_t size = bins.size(), count = std::min(std::max<std::size_t>(size / 10, 3), size);
    const auto first = bins.power.begin() + static_cast<std::ptrdiff_t>(highest ? size - count : 0);
    std::vector<double> some(first, first + static_cast<std::ptrdiff_t>(count));
    std::sort(some.begin(), some.end());
    return some[count / 2];
}

}  // namespace noise_models
}  // namespace fltea
