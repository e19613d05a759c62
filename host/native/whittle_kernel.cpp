// The table of the functions with which noise models are fitted (whittle_kernel.hpp), for one instruction
// set. The sums over bins are here, and the spectra of the noise parts in whittle_spectra.hpp. CMakeLists.txt
// compiles this file once for each instruction set. Neither this file nor the headers that it includes may
// call an inline function of the standard library: the linker would keep only one of its compiled copies, and
// use this copy for all instruction sets.
#include "whittle_kernel.hpp"

#include <type_traits>

#include "bin_loops.hpp"
#include "pack_log.hpp"
#include "set_name.hpp"
#include "whittle_spectra.hpp"

namespace fltea {
namespace noise_models {
inline namespace FLTEA_INSTRUCTION_SET {
namespace {

using engine::log;

double nll(const Columns& b, const double* total) {
    double found;
    sums_of<1>(
        b.size,
        [=](auto* terms, std::size_t i) {
            typedef typename std::remove_pointer<decltype(terms)>::type T;
            const T here = from<T>(total + i);
            terms[0] = from<T>(b.counts + i) * (log(here) + from<T>(b.power + i) / here);
        },
        &found);
    return found;
}

// Computes up to four sums of products together, because in a single sum each addition would have to wait for
// the previous one.
template <int kSums>
void some_dots(std::size_t size, const double* a, const double* const* rows, double* found) {
    sums_of<kSums>(
        size,
        [=](auto* terms, std::size_t i) {
            typedef typename std::remove_pointer<decltype(terms)>::type T;
            const T one = from<T>(a + i);
#pragma GCC unroll 8
            for (int j = 0; j < kSums; ++j) terms[j] = one * from<T>(rows[j] + i);
        },
        found);
}

void dots(std::size_t size, const double* a, int count, const double* const* rows, double* found) {
    for (; count >= 4; count -= 4, rows += 4, found += 4) some_dots<4>(size, a, rows, found);
    if (count == 3) some_dots<3>(size, a, rows, found);
    if (count == 2) some_dots<2>(size, a, rows, found);
    if (count == 1) some_dots<1>(size, a, rows, found);
}

void times(std::size_t size, const double* a, const double* b, double* into) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(into + i, from<T>(a + i) * from<T>(b + i));
    });
}

void plus(std::size_t size, const double* a, double* into) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(into + i, from<T>(into + i) + from<T>(a + i));
    });
}

void inverted(std::size_t size, double* a, double* inverse) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T here = from<T>(a + i);
        to(inverse + i, T(1.0) / here);
        to(a + i, log(here));
    });
}

void whole(std::size_t size, const double* gain, double* total, double* floor, double* inverse,
           double* over) {
    each(size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        const T passed = from<T>(total + i) * from<T>(gain + i), all = passed + from<T>(floor + i);
        const T by = T(1.0) / all;
        to(total + i, all);
        to(floor + i, passed / all);
        to(inverse + i, by);
        to(over + i, from<T>(gain + i) * by);
    });
}

void derivatives(const Columns& b, const double* total, int free, const double* const* slopes, double* over,
                 double* gradient, double* information) {
    each(b.size, [=](auto one, std::size_t i) {
        typedef decltype(one) T;
        to(over + i, from<T>(b.counts + i) * (T(1.0) - from<T>(b.power + i) / from<T>(total + i)));
    });
    dots(b.size, over, free, slopes, gradient);
    for (int k = 0; k < free; ++k) {
        times(b.size, b.counts, slopes[k], over);
        dots(b.size, over, k + 1, slopes, information + k * kMostFree);
        for (int j = 0; j < k; ++j) information[j * kMostFree + k] = information[k * kMostFree + j];
    }
}

}  // namespace
}  // namespace FLTEA_INSTRUCTION_SET

extern const Kernel FLTEA_JOIN(kernel_, FLTEA_INSTRUCTION_SET) = {
    FLTEA_STRING(FLTEA_INSTRUCTION_SET), term_at, nll, whole, derivatives, dots, times, plus, inverted};

}  // namespace noise_models
}  // namespace fltea
