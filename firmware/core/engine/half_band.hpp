// Halves the rate of a stream. A half-band low-pass filter of 31 taps (Kaiser window, β = 8) is applied, and
// then every second sample is removed.
//
// Here and in the other files of the running spectrum, the template parameter Kind has the number types of
// the computation: integers (count_spectrum.hpp) or floating point (host/native/real_spectrum.hpp).
#pragma once

#include <cstddef>

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

// The filter. After the removal of every second sample, the proportion of aliased power at frequencies below
// 0.35 of the original Nyquist frequency is less than 5e-6.
template <typename Kind>
struct HalfBand {
    typedef typename Kind::Value Value;
    typedef typename Kind::Sum Sum;
    typedef typename Kind::Coefficient Coefficient;

    // An output of the filter is computed from a sample and the kReach samples before it. The output stands
    // for the sample in the middle of these samples.
    enum { kReach = 30, kDelay = 15, kMost = 128, kTaps = 8 };

    // The middle tap of the filter, and the taps at the distances 15, 13, ... 1 from it. All other taps are
    // 0.
    static Coefficient middle() { return Kind::coefficient(0.49998341447554523); }
    static Coefficient tap(int k) {
        static const Coefficient taps[kTaps] = {
            Kind::coefficient(-4.962987862434643e-05), Kind::coefficient(0.0006422540255711147),
            Kind::coefficient(-0.002734441417494108),  Kind::coefficient(0.00802032401027231),
            Kind::coefficient(-0.019227637930233975),  Kind::coefficient(0.0415367046593286),
            Kind::coefficient(-0.09122480814029417),   Kind::coefficient(0.3130455274337019)};
        return taps[k];
    }

    // Halves the sampling rate: filters x, but computes only every second output. Of these, it writes to
    // `out` those whose newest sample has an index from first_place(from) to before `to`. Returns their
    // number. first_place() is even. x therefore has to begin at the first sample after a break of the
    // stream, or an even number of samples later. to - from is at most kMost. `level`: level of the running
    // spectrum to which x belongs, which determines the units of x and of the outputs.
    template <typename Stored>
    static int run(const Stored* x, int from, int to, int level, Value* out) {
        const int first = first_place(from), outputs = to > first ? (to - first + 1) / 2 : 0;
        if (outputs == 0) return 0;
        Value even[kMost / 2 + kReach / 2 + 1];
        Sum sum[kMost / 2];
        const Stored* const oldest = x + first - kReach;
        for (int i = 0; i < outputs + kReach / 2; ++i) even[i] = Value(oldest[std::ptrdiff_t(2) * i]);
        for (int i = 0; i < outputs; ++i) sum[i] = middle() * Sum(oldest[std::ptrdiff_t(2) * i + kDelay]);
        for (int k = 0; k < kTaps; ++k) {
            const Coefficient c = tap(k);
            const Value* const left = even + k;
            const Value* const right = even + kReach / 2 - k;
            for (int i = 0; i < outputs; ++i) sum[i] += c * Sum(left[i] + right[i]);
        }
        for (int i = 0; i < outputs; ++i) out[i] = Kind::filtered(sum[i], level);
        return outputs;
    }

    static int first_place(int from) { return from <= kReach ? int(kReach) : from + from % 2; }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
