// Multiplies a block of 256 real numbers by Hann's window, and computes the squared magnitude of its Fourier
// transform. One complex transform of 128 numbers is enough for this.
#pragma once

#include "instruction_set.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

template <typename Kind>
class BlockFft {
    typedef typename Kind::Value Value;
    typedef typename Kind::Coefficient Coefficient;
    typedef typename Kind::Tables Tables;

  public:
    typedef typename Kind::Power Power;
    enum { kBlock = 256, kHalf = kBlock / 2 };

    // Sum of the squared values of the window. For white noise of variance R, the mean power at every
    // frequency is R times this sum.
    static constexpr double scale() { return 0.375 * double(kBlock); }

    // Working memory of the transform. At the end it has the powers at all frequencies.
    class Work {
        friend class BlockFft;
        union Half {
            Value part[2][kHalf];  // real parts, then imaginary parts
            Power power[kHalf];
        } half_[2];
    };

    // powers() computes power[i], the power at the frequency with index low + i, for i < lines. low is at
    // least 1, and low + lines at most 128. The mean of the block is subtracted first to avoid rounding
    // errors. After the multiplication by the window, the mean would affect only lines 0 and 1. If `places`
    // is n, the unit of the powers is 2^-2n times the squared unit of x.
    struct Powers {
        const Power* power;  // points into `work`
        int places;
    };
    template <typename Stored>
    static Powers powers(const Stored* x, int low, int lines, Work& work) {
        const Tables& tables = Kind::tables();
        const typename Kind::template Centred<Stored> centred(x, int(kBlock));
        for (int i = 0; i < kHalf; ++i) {
            work.half_[0].part[0][i] = Kind::product(centred[2 * i], tables.even(i));
            work.half_[0].part[1][i] = Kind::product(centred[2 * i + 1], tables.odd(i));
        }
        const int at = transform(tables, work);
        const Value* const a = work.half_[at].part[0];
        const Value* const b = work.half_[at].part[1];
        Power* const power = work.half_[1 - at].power;
        for (int i = 0; i < lines; ++i) {
            const int k = low + i, mirror = kHalf - k;
            const Value even_re = (a[k] + a[mirror]) / 2, even_im = (b[k] - b[mirror]) / 2;
            const Value odd_re = (b[k] + b[mirror]) / 2, odd_im = (a[mirror] - a[k]) / 2;
            const Coefficient c = tables.cosine(k), s = tables.sine(k);
            const Value line_re = even_re + Kind::product(odd_re, c) + Kind::product(odd_im, s);
            const Value line_im = even_im + Kind::product(odd_im, c) - Kind::product(odd_re, s);
            power[i] = Power(line_re) * Power(line_re) + Power(line_im) * Power(line_im);
        }
        return Powers{power, centred.places()};
    }

  private:
    // Transforms by Stockham's algorithm: every step reads one half of the working memory and writes the
    // other half, in such an order that the result is sorted by frequency. Returns the index of the half with
    // the result.
    static int transform(const Tables& tables, Work& work) {
        int from = 0;
        for (int stride = 1; stride < kHalf; stride *= 2, from = 1 - from) {
            const int pairs = kHalf / 2 / stride;
            for (int p = 0; p < pairs; ++p) {
                // e^{-i angle} = c - i s is the factor of pair p; angle = 2 pi p / (2 pairs)
                const Coefficient c = tables.cosine(2 * p * stride), s = tables.sine(2 * p * stride);
                const Value* const ar = work.half_[from].part[0] + stride * p;
                const Value* const ai = work.half_[from].part[1] + stride * p;
                const Value* const br = ar + kHalf / 2;
                const Value* const bi = ai + kHalf / 2;
                Value* const sum_r = work.half_[1 - from].part[0] + 2 * stride * p;
                Value* const sum_i = work.half_[1 - from].part[1] + 2 * stride * p;
                Value* const turned_r = sum_r + stride;
                Value* const turned_i = sum_i + stride;
                for (int q = 0; q < stride; ++q) {
                    const Value dr = ar[q] - br[q], di = ai[q] - bi[q];
                    sum_r[q] = ar[q] + br[q];
                    sum_i[q] = ai[q] + bi[q];
                    turned_r[q] = Kind::products(dr, c, di, s);
                    turned_i[q] = Kind::products(di, c, dr, -s);
                }
            }
        }
        return from;
    }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
