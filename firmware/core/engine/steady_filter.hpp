// Designs the Kalman filter for the noise model that the device's fit has found: relaxations (first-order
// Gauss-Markov processes) in white noise. The filter always uses the gains of its steady state. A fractional
// order is approximated by a sum of relaxations with fixed poles. The design is done in small slices, so that
// sampling does not wait.
//
// If there are only relaxations, no Riccati equation has to be solved. The model's spectrum is
// R + Σ q_i / |1 - a_i e^-iλ|²: white noise of variance R, and relaxations with poles a_i whose innovations
// have the variances q_i. As a function of s = -|1 - e^-iλ|² it has real poles and zeros, one zero b next to
// each pole a. It therefore equals S Π|1 - b_i e^-iλ|² / Π|1 - a_i e^-iλ|², where S is the variance of the
// filter's innovations. The zeros b are found by bisection. The gains are the residues of
// Π(1 - b_i z) / Π(1 - a_i z).
#ifndef FLTEA_STEADY_FILTER_HPP
#define FLTEA_STEADY_FILTER_HPP

#include "fit_memory.hpp"
#include "whittle_shapes.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// A Kalman filter in its steady state. For each sample y it computes x_i <- a_i x_i (prediction), e = y - Σ
// x_i (innovation), and x_i <- x_i + K_i e (update of part i with gain K_i).
struct SteadyFilter {
    // Part 0 is the fitted relaxation, if the verdict of the fit is a relaxation. The other parts are used if
    // the verdict is a fractional order: their sum approximates the noise of that order.
    enum { kPlaces = 8 };

    float fall[kPlaces];      // 1 - a: the proportion by which the part falls per sample
    float variance[kPlaces];  // variance of the part; 0: the part does not exist
    float gain[kPlaces];      // gain K with which an innovation changes the part
    float R, S;               // R: variance of the white noise; S: variance of the innovations
    float of_state;           // variance of the estimated state, if the offset is known exactly
    float answer;             // if all samples are 1, the innovations converge to this value
    float weight[kPlaces];    // a part's expected mean over the next samples is its present value times this
    // variance of the estimated mean of the state over the next samples, if the offset is known exactly
    float of_bias;
    // A wrong offset shifts the bias and the innovations. This is the first shift divided by the second.
    float offset_in_bias;
};

class FilterDesign {
  public:
    enum { kPlaces = SteadyFilter::kPlaces };

    // Begins the design. `figures`: a fit whose verdict is not white noise. The filter's bias is the mean
    // over the next `ahead` samples. If `ahead` is 0, it is the present bias.
    void begin(const FitFigures& figures, int ahead) {
        filter_ = SteadyFilter();
        ahead_ = ahead;
        for (int i = 0; i < kPlaces; ++i) filter_.fall[i] = fall_of(i);
        filter_.R = figures.R;
        step_ = kZeros;
        if (figures.verdict == Verdict::relaxation) {
            filter_.fall[0] = figures.relaxation_fall;
            filter_.variance[0] = figures.relaxation_variance;
            filter_.R = figures.relaxation_R;
        } else if (figures.verdict == Verdict::fractional) {
            begin_order(figures);
        }
    }

    // Does one slice of the design. Returns true when the design is done.
    bool work() {
        if (step_ < kRows) {
            add_row();
        } else if (step_ < kZeros) {
            sweep();
        } else if (step_ < kGains) {
            if (!find_zero(step_ - kZeros)) return false;
        } else if (step_ < kWeights) {
            find_gain(step_ - kGains);
        } else if (step_ < kDone) {
            look_ahead(step_ - kWeights);
        } else {
            conclude();
            return true;
        }
        ++step_;
        return false;
    }

    const SteadyFilter& filter() const { return filter_; }

  private:
    enum {
        // number of frequencies at which the relaxations have to match the spectrum of the fractional order
        kRows = 12,
        kSweeps = 12,
        kZeros = kRows + kSweeps,
        kGains = kZeros + kPlaces,
        kWeights = kGains + kPlaces,
        kDone = kWeights + kPlaces,
        // largest number of bisection steps in one call: the filter is designed in slices, between samples
        kBisections = 8,
        kSame = 8  // accuracy to which a zero of the spectrum is computed, in units of the last place
    };
    // frequencies at which the spectrum of a fractional order is approximated: the lowest one [rad per
    // sample], and the ratio of each frequency to the one below
    static constexpr float kLowest = 3e-4f, kRatio = 2.2977f;
    // Errors of the approximated spectrum are divided by (spectrum of the state + kMatters R), with the
    // variance R of the white noise. So they are relative errors where the state is strong, and count less
    // where its spectrum is below kMatters R.
    static constexpr float kMatters = 0.3f;

    static float fall_of(int place) {
        static const float falls[kPlaces] = {1,         1,          0.75f,       1.0f / 8,
                                             1.0f / 64, 1.0f / 512, 1.0f / 4096, 1.75f};
        return falls[place];
    }

    // A frequency, with the functions of it that whittle_shapes.hpp needs to compute a spectrum.
    struct Frequency {
        explicit Frequency(float lam) : lam_(lam), size_(2.0f * math::sin_pi(lam * 0.1591549431f)) {}
        float ln_size(std::size_t) const { return math::log(size_); }
        float quarter(std::size_t) const { return (3.1415926536f - lam_) * 0.5f; }
        float turn(std::size_t) const { return lam_; }
        float square() const { return size_ * size_; }

      private:
        float lam_, size_;
    };

    void begin_order(const FitFigures& figures) {
        shape_.shape[0] = figures.alpha;
        shape_.shape[1] = figures.g;
        s2_ = figures.s2;
        lam_ = kLowest;
        for (int i = 0; i < kPlaces; ++i) {
            right_[i] = 0;
            for (int j = 0; j < kPlaces; ++j) gram_[i][j] = 0;
        }
        step_ = 0;
    }

    // Adds the next frequency to the least-squares problem for the variances of the relaxations. The problem
    // minimizes relative errors of the spectrum.
    void add_row() {
        const Frequency at(lam_);
        lam_ *= kRatio;
        float part = 0, shape[kPlaces];
        Fractional<float>(shape_).parts(at, 0, &part);
        const float wanted = s2_ * part, weight = 1.0f / (wanted + kMatters * filter_.R);
        for (int i = 1; i < kPlaces; ++i) {
            const float fall = filter_.fall[i], square = at.square();
            shape[i] = weight * fall * (2.0f - fall) / (fall * fall + (1.0f - fall) * square);
            right_[i] += shape[i] * (weight * wanted);
            for (int j = 1; j <= i; ++j) gram_[i][j] += shape[i] * shape[j];
        }
    }

    // Improves each variance in turn, while the others stay as they are. A variance that would become
    // negative is set to 0.
    void sweep() {
        for (int i = 1; i < kPlaces; ++i) {
            float rest = right_[i];
            for (int j = 1; j < kPlaces; ++j) {
                if (j != i) rest -= (j < i ? gram_[i][j] : gram_[j][i]) * filter_.variance[j];
            }
            filter_.variance[i] = math::fmax(rest / gram_[i][i], 0);
        }
    }

    bool there(int i) const { return filter_.variance[i] > 0; }
    // Whether the pole of a part is 0. Such a part has no memory from sample to sample: it is white noise,
    // but a part of the state and not of the measurement.
    bool white(int i) const { return filter_.fall[i] == 1.0f; }
    bool coloured(int i) const { return there(i) && !white(i); }
    bool turns(int i) const { return filter_.fall[i] > 1.0f; }
    // For the pole a of part i, size(i) is |a|, and short_of_one(i) is 1 - |a|.
    float size(int i) const { return turns(i) ? filter_.fall[i] - 1.0f : 1.0f - filter_.fall[i]; }
    float short_of_one(int i) const { return turns(i) ? 2.0f - filter_.fall[i] : filter_.fall[i]; }
    // On the axis of s = z + 1/z - 2, all real frequencies (z = e^iλ) are between -4 and 0. The pole z = a of
    // a part lies outside: above 0 if a > 0, and below -4 if a < 0. Returns the pole's distance from 0 or
    // from -4.
    float pole(int i) const { return short_of_one(i) * short_of_one(i) / size(i); }

    // Finds the zero of the spectrum that belongs to the pole of part i. The spectrum is the sum of all parts
    // and the white noise, and pole() explains the axis on which the zero lies: farther out than the pole.
    // Writes the distance from the pole to the zero to apart_[i]. Returns false if the search has to go on in
    // the next call.
    bool find_zero(int i) {
        if (!coloured(i)) return true;
        if (low_ == high_) begin_zero(i);
        for (int k = 0; k < kBisections && high_ - low_ > kSame; ++k) {
            const std::uint32_t middle = (low_ + high_) / 2;
            (beyond(i, of_bits(middle)) > 0 ? high_ : low_) = middle;
        }
        if (high_ - low_ > kSame) return false;
        apart_[i] = of_bits(low_);
        low_ = high_ = 0;
        const float at = pole(i) + apart_[i], root = math::sqrt(at * at + 4.0f * at);
        zero_[i] = 2.0f / (2.0f + at + root);
        zero_short_of_one_[i] = (at + root) / (2.0f + at + root);
        return true;
    }

    void begin_zero(int i) {
        measured_ = filter_.R;
        float all = 0;
        for (int j = 0; j < kPlaces; ++j) {
            if (there(j) && white(j)) measured_ += filter_.variance[j];
            if (!coloured(j)) continue;
            poles_[j] = pole(j);
            strength_[j] = filter_.variance[j] * filter_.fall[j] * (2.0f - filter_.fall[j]) / size(j);
            if (turns(j) == turns(i)) all += strength_[j];
        }
        float most = all / measured_;
        for (int j = 0; j < kPlaces; ++j) {
            if (coloured(j) && turns(j) == turns(i) && poles_[j] > poles_[i])
                most = math::fmin(most, poles_[j] - poles_[i]);
        }
        low_ = 0x00800000;
        high_ = bits_of(most);
        if (high_ < low_) high_ = low_ + 1;
    }

    // Returns the spectrum at a point of the axis that pole() explains: at the distance d beyond the pole of
    // part i.
    float beyond(int i, float d) const {
        float sum = measured_;
        for (int j = 0; j < kPlaces; ++j) {
            if (!coloured(j)) continue;
            sum += strength_[j] /
                   (turns(j) == turns(i) ? poles_[j] - poles_[i] - d : 4.0f + poles_[j] + poles_[i] + d);
        }
        return sum;
    }

    // Computes the gain of part i: the residue of Π(1 - b z) / Π(1 - a z) at the part's pole a, divided by a.
    // The products are over all zeros b and poles a.
    void find_gain(int i) {
        if (!coloured(i)) return;
        float gain = apart_[i] * zero_[i] / between(size(i), short_of_one(i), i);
        for (int j = 0; j < kPlaces; ++j) {
            if (j == i || !coloured(j)) continue;
            if (turns(i) != turns(j)) {
                gain *= (size(i) + zero_[j]) / (size(i) + size(j));
                continue;
            }
            const float gap = poles_[j] - poles_[i];
            const float of_poles = short_of_one(i) + short_of_one(j) * size(i);
            gain *= (gap + apart_[j]) / gap * (zero_[j] / size(j)) *
                    (of_poles / between(size(i), short_of_one(i), j));
        }
        filter_.gain[i] = gain;
    }

    // Returns 1 - a b_j for a pole a and a zero b_j of the same sign.
    float between(float a, float short_of_one, int j) const {
        return short_of_one + a * zero_short_of_one_[j];
    }

    // Computes how the mean of part i of the state over the next `ahead_` samples follows from the present:
    // the weight of the part's present value in that mean, and the variance that future noise adds to the
    // mean.
    void look_ahead(int i) {
        filter_.weight[i] = ahead_ == 0 ? 1.0f : 0.0f;
        if (!there(i) || ahead_ == 0) return;
        const float fall = filter_.fall[i], a = 1.0f - fall;
        float answer = 0, squares = 0;
        for (int k = 0; k < ahead_; ++k) {
            answer = a * answer + 1.0f;
            squares += answer * answer;
        }
        const float share = 1.0f / static_cast<float>(ahead_);
        filter_.weight[i] = a * answer * share;
        filter_.of_bias += filter_.variance[i] * fall * (2.0f - fall) * squares * share * share;
    }

    void conclude() {
        // S, the variance of the innovations, is `measured` times Π a/b, over all poles a and zeros b.
        // `measured` becomes the variance of all white noise. `more` is Π a/b - 1, computed without a
        // subtraction, so that small values keep their precision.
        float more = 0, slow = 0, now = 0;
        float measured = filter_.R;
        for (int i = 0; i < kPlaces; ++i) {
            if (!there(i)) continue;
            if (white(i)) {
                now += filter_.variance[i];
                continue;
            }
            const float of_one = apart_[i] * size(i) / between(size(i), short_of_one(i), i);
            more += of_one + more * of_one;
            slow += filter_.gain[i] * (1.0f - filter_.fall[i]) / filter_.fall[i];
        }
        measured += now;
        const float predicted = now + measured * more;
        filter_.S = filter_.R + predicted;
        for (int i = 0; i < kPlaces; ++i) {
            if (there(i) && white(i)) filter_.gain[i] = filter_.variance[i] / filter_.S;
        }
        filter_.of_state = filter_.R * predicted / filter_.S;
        filter_.answer = 1.0f / (1.0f + slow);
        conclude_bias();
    }

    // Computes the variance of the bias, given all samples. It follows from the covariances of the parts. The
    // covariance of parts i and j is -S K_i K_j / (1 - a_i a_j), plus the variance of part i if i = j. S is
    // the variance of the innovations, K a gain and a a pole.
    void conclude_bias() {
        filter_.offset_in_bias = 1.0f / filter_.answer;
        for (int i = 0; i < kPlaces; ++i) {
            if (!there(i)) continue;
            const float u = filter_.weight[i], a = 1.0f - filter_.fall[i], K = filter_.gain[i];
            float known = 0;
            for (int j = 0; j < kPlaces; ++j) {
                if (!there(j)) continue;
                // This is 1 - a_i a_j, computed from 1 - a_i and 1 - a_j. If both poles are near 1, the
                // difference itself would lose its digits.
                const float fall = filter_.fall[i] + a * filter_.fall[j];
                known += filter_.weight[j] * filter_.gain[j] / fall;
            }
            filter_.of_bias += u * (u * filter_.variance[i] - filter_.S * K * known);
            filter_.offset_in_bias -= u * K / filter_.fall[i];
        }
        filter_.of_bias = math::fmax(filter_.of_bias, 0);
    }

    static std::uint32_t bits_of(float x) {
        std::uint32_t bits = 0;
        std::memcpy(&bits, &x, sizeof bits);
        return bits;
    }
    static float of_bits(std::uint32_t bits) {
        float x = 0;
        std::memcpy(&x, &bits, sizeof x);
        return x;
    }

    SteadyFilter filter_;
    int step_ = 0, ahead_ = 0;
    Natural<float> shape_;
    float s2_, lam_, gram_[kPlaces][kPlaces], right_[kPlaces];
    // bounds of the distance of a zero from its pole, between which find_zero() searches; stored as the bits
    // of floats, which as integers have the same order as the floats
    std::uint32_t low_ = 0, high_ = 0;
    float measured_, poles_[kPlaces], strength_[kPlaces];
    float apart_[kPlaces], zero_[kPlaces], zero_short_of_one_[kPlaces];
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
