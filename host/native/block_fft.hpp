// |FFT|^2 of a block of 256 real numbers under Hann's window, as one complex transform of 128.
#pragma once

#include <cmath>

namespace fltea {

template <typename Number>
class BlockFft {
  public:
    enum { kBlock = 256, kHalf = kBlock / 2 };

    // Sum of the squares of the window: white noise of variance R has so much times R in every line.
    static double scale() { return 0.375 * kBlock; }

    // One for all: nothing but tables.
    static const BlockFft& shared() {
        static const BlockFft one;
        return one;
    }

    // power[i] of line low + i, i < lines; 1 <= low, low + lines <= 128. The mean is taken off first, of
    // which the window would let lines 0 and 1 alone see anything, against rounding.
    template <typename Stored>
    void power(const Stored* x, int low, int lines, Number* power) const {
        Number re[2][kHalf], im[2][kHalf];
        Number sums[4] = {0, 0, 0, 0};
        for (int i = 0; i < kBlock; i += 4) {
            for (int k = 0; k < 4; ++k) sums[k] += Number(x[i + k]);
        }
        const Number mean = ((sums[0] + sums[1]) + (sums[2] + sums[3])) / Number(kBlock);
        for (int i = 0; i < kHalf; ++i) {
            re[0][i] = (Number(x[2 * i]) - mean) * even_[i];
            im[0][i] = (Number(x[2 * i + 1]) - mean) * odd_[i];
        }
        const int at = transform(re, im);
        const Number* const a = re[at];
        const Number* const b = im[at];
        for (int i = 0; i < lines; ++i) {
            const int k = low + i, mirror = kHalf - k;
            const Number even_re = (a[k] + a[mirror]) / 2, even_im = (b[k] - b[mirror]) / 2;
            const Number odd_re = (b[k] + b[mirror]) / 2, odd_im = (a[mirror] - a[k]) / 2;
            const Number line_re = even_re + cosine_[k] * odd_re + sine_[k] * odd_im;
            const Number line_im = even_im + cosine_[k] * odd_im - sine_[k] * odd_re;
            power[i] = line_re * line_re + line_im * line_im;
        }
    }

  private:
    BlockFft() {
        const double turn = 2 * 3.14159265358979323846 / kBlock;
        for (int i = 0; i < kHalf; ++i) {
            even_[i] = Number(0.5 - 0.5 * std::cos(turn * (2 * i)));
            odd_[i] = Number(0.5 - 0.5 * std::cos(turn * (2 * i + 1)));
            cosine_[i] = Number(std::cos(turn * i));
            sine_[i] = Number(std::sin(turn * i));
        }
    }

    // Stockham's: every step reads one pair of arrays and writes the other, in an order that leaves the
    // result sorted. Returns which pair has it.
    int transform(Number re[2][kHalf], Number im[2][kHalf]) const {
        int from = 0;
        for (int stride = 1; stride < kHalf; stride *= 2, from = 1 - from) {
            const int pairs = kHalf / 2 / stride;
            for (int p = 0; p < pairs; ++p) {
                // e^{-2 pi i p / (2 pairs)}
                const Number c = cosine_[2 * p * stride], s = sine_[2 * p * stride];
                const Number* const ar = re[from] + stride * p;
                const Number* const ai = im[from] + stride * p;
                const Number* const br = ar + kHalf / 2;
                const Number* const bi = ai + kHalf / 2;
                Number* const sum_r = re[1 - from] + 2 * stride * p;
                Number* const sum_i = im[1 - from] + 2 * stride * p;
                Number* const turned_r = sum_r + stride;
                Number* const turned_i = sum_i + stride;
                for (int q = 0; q < stride; ++q) {
                    const Number dr = ar[q] - br[q], di = ai[q] - bi[q];
                    sum_r[q] = ar[q] + br[q];
                    sum_i[q] = ai[q] + bi[q];
                    turned_r[q] = dr * c + di * s;
                    turned_i[q] = di * c - dr * s;
                }
            }
        }
        return from;
    }

    Number even_[kHalf], odd_[kHalf], cosine_[kHalf], sine_[kHalf];
};

}  // namespace fltea
