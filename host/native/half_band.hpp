// Every second sample of a low-pass filtered stream: a half-band filter of 31 taps (Kaiser 8).
#pragma once

#include <cmath>

namespace fltea {

// What folds over onto frequencies below 0.35 of Nyquist's comes through with less than 5e-6 of its power.
template <typename Number>
struct HalfBand {
    // An output needs the newest sample and so many before it; it stands for the one in the middle.
    enum { kReach = 30, kDelay = 15, kMost = 128 };

    // Of the middle, and of the distances 15, 13, ... 1 from it; all other taps are 0.
    static Number middle() { return Number(0.49998341447554523); }
    static Number tap(int k) {
        static const Number taps[8] = {Number(-4.962987862434643e-05), Number(0.0006422540255711147),
                                       Number(-0.002734441417494108),  Number(0.00802032401027231),
                                       Number(-0.019227637930233975),  Number(0.0415367046593286),
                                       Number(-0.09122480814029417),   Number(0.3130455274337019)};
        return taps[k];
    }

    // Outputs whose newest sample has an even place in [from, to) of x, which begins where the stretch does
    // or an even number of samples later; to - from is at most kMost. Returns how many; the first one's
    // newest sample is at first_place(from).
    template <typename Stored>
    static int run(const Stored* x, int from, int to, Number* out) {
        const int first = first_place(from), outputs = to > first ? (to - first + 1) / 2 : 0;
        if (outputs == 0) return 0;
        Number even[kMost / 2 + kReach / 2 + 1];
        const Stored* const oldest = x + first - kReach;
        for (int i = 0; i < outputs + kReach / 2; ++i) even[i] = Number(oldest[2 * i]);
        for (int i = 0; i < outputs; ++i) out[i] = middle() * Number(oldest[2 * i + kDelay]);
        for (int k = 0; k < 8; ++k) {
            const Number c = tap(k);
            const Number* const left = even + k;
            const Number* const right = even + kReach / 2 - k;
            for (int i = 0; i < outputs; ++i) out[i] += c * (left[i] + right[i]);
        }
        return outputs;
    }

    static int first_place(int from) { return from <= kReach ? int(kReach) : from + from % 2; }

    // Of a cosine of so many rad a sample (before every second sample is left out).
    static double gain(double angle) {
        double sum = double(middle());
        for (int k = 0; k < 8; ++k) sum += 2 * double(tap(k)) * std::cos((kDelay - 2 * k) * angle);
        return sum;
    }
};

}  // namespace fltea
