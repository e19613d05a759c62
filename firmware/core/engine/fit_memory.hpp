// The results of a fit on the device for one axis, and the state that is kept for the next fit.
#ifndef FLTEA_FIT_MEMORY_HPP
#define FLTEA_FIT_MEMORY_HPP

#include "null_quantiles.hpp"
#include "order_interval.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// What a fit on the device says about the kind of an axis's noise.
enum class Verdict : int {
    none,   // there was no fit yet, or there is nothing to fit
    white,  // white noise is not rejected
    // white noise is rejected, and 2 log L of the fractional model exceeds that of a relaxation, AR(1), by
    // more than 6
    fractional,
    // white noise is rejected, and AR(1) describes the noise about as well as the fractional model
    relaxation,
};

struct FitFigures {
    Verdict verdict;
    // The figures of a fit. For white noise all figures are 0, except the variance R of the white noise and
    // the figures of the relaxation. α ± 1.96 alpha_std contains the 95 % interval of the likelihood;
    // alpha_std is 0 if the interval is not known.
    float alpha, alpha_std;
    float g;  // g = h^α f, where h is the sampling period
    // variance of a step of the state, and variance of the white noise, in the unit of the bins' powers
    float s2, R;
    float ratio_white;  // 2 log L of the best model with an order up to 1, minus that of white noise
    float ratio_ar1;    // 2 log L of the fractional model, minus that of a relaxation, AR(1)
    // The best relaxation, AR(1) with the coefficient φ, in white noise: 1 - φ, the variance of the
    // relaxation, and the variance of the white noise.
    float relaxation_fall, relaxation_variance, relaxation_R;
    float ordinates;
    bool alpha_defined;  // whether the 95 % interval of α is clearly shorter than the range of all orders
};

template <class Bins>
class SlicedFit;

// What is kept of an axis from one fit to the next. These are the last results, from which the next fit
// starts, and the progress of the grid searches, which are repeated from time to time.
class FitMemory {
  public:
    // `turn`: Every twelfth fit of an axis repeats the grid search. Axes with different values of `turn`
    // repeat it in different rounds of fits.
    explicit FitMemory(int turn = 0) : figures_(), fitted_ordinates_(0), turn_(turn) {
        for (Answer& one : answers_) {
            one.known = false;
            one.look = 0;
        }
        ends_.known = false;
        ends_.turn = ends_.look = 0;
    }
    const FitFigures& figures() const { return figures_; }

  private:
    template <class Bins>
    friend class SlicedFit;

    enum Which { kWhiteNoise, kRelaxation, kUpToOne, kFull, kModels };
    struct Answer {
        float theta[3];
        float nll, scale;
        bool known;
        unsigned char look;  // index of the grid point that will be tested next
    };
    // Writes all figures of a fit except the interval of the order. `full`: the model kFull, which allows
    // every order. `unit`: the power that the fit counts as 1. Returns whether white noise is rejected. If it
    // is not, there is no order, and no interval of it to compute.
    bool report(const Model<float>& full, NullLevel level, float ordinates, float unit) {
        const Answer& best = answers_[kFull];
        FitFigures& f = figures_;
        f = FitFigures();
        f.ordinates = ordinates;
        f.ratio_white = 2.0f * (answers_[kWhiteNoise].nll - answers_[kUpToOne].nll);
        f.ratio_ar1 = 2.0f * (answers_[kRelaxation].nll - best.nll);
        note_relaxation(unit);
        // If white noise is not rejected, all power is white noise, so R is the whole power. The R of the
        // best fractional model may be smaller, because that model may have taken white noise for its state.
        if (f.ratio_white < null_quantile(level, f.ordinates)) {
            f.verdict = Verdict::white;
            f.R = unit;
            return false;
        }
        f.verdict = f.ratio_ar1 > kApart ? Verdict::fractional : Verdict::relaxation;
        Mapped<float> at;
        map(full, best.theta, at);
        const float power = best.scale * unit;
        f.alpha = at.natural.shape[0];
        f.g = at.natural.shape[1];
        f.s2 = at.natural.variance[0] * power;
        f.R = at.natural.white * power;
        return true;
    }
    void note_relaxation(float unit) {
        const Answer& answer = answers_[kRelaxation];
        if (!answer.known) return;
        // theta[0] and theta[1] are the logits of numbers between 0 and 1. 1 minus such a number is computed
        // from the negated logit, because a subtraction would lose digits if the number is close to 1.
        const float fall = 2.0f * Share<float>(-answer.theta[0]).value, power = answer.scale * unit;
        figures_.relaxation_fall = fall;
        figures_.relaxation_variance = Share<float>(answer.theta[1]).value * power / (fall * (2.0f - fall));
        figures_.relaxation_R = Share<float>(-answer.theta[1]).value * power;
    }

    // An order is reported if 2 log L of the fractional model exceeds that of a relaxation, AR(1), by more
    // than this.
    static constexpr float kApart = 6.0f;

    Answer answers_[kModels];
    OrderEnds ends_;
    FitFigures figures_;
    float fitted_ordinates_;
    int turn_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
