// The results of a fit on the device for one axis, and the state that is kept for the next fit.
#ifndef FLTEA_FIT_MEMORY_HPP
#define FLTEA_FIT_MEMORY_HPP

#include "order_interval.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// Verdict of the fit on the fractional model and on the noise.
enum class Verdict : int {
    none,        // no fit yet, or nothing to fit
    white,       // white noise is not rejected
    fractional,  // white noise is rejected, and AR(1) is worse by more than 6 in 2 log L
    relaxation,  // white noise is rejected, and AR(1) describes the noise as well
};

struct FitFigures {
    Verdict verdict;
    // For white noise all of them are 0, except R and those of the relaxation. alpha_std: α ± 1.96 alpha_std
    // contains the 95 % interval of the likelihood; 0 if it is not known.
    float alpha, alpha_std;
    float g;            // h^α f
    float s2, R;        // in the squared unit of the bins' powers
    float ratio_white;  // 2 log L of orders up to 1, relative to white noise
    float ratio_ar1;    // 2 log L of the fractional model, relative to AR(1)
    // The relaxation: 1 - φ, its variance, and the variance of the white noise that goes with it.
    float relaxation_fall, relaxation_variance, relaxation_R;
    float ordinates;
    bool alpha_defined;  // the interval of α is clearly shorter than the whole range
};

template <class Bins>
class SlicedFit;

// State of an axis that is kept between fits: the answers, where the next fit starts, and the progress of its
// repeated grid searches.
class FitMemory {
  public:
    // `turn`: which of twelve fits repeats the grid search, so that several axes do so in different rounds.
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
        unsigned char look;  // next point of the grid to test
    };
    void note_relaxation(float unit) {
        const Answer& answer = answers_[kRelaxation];
        if (!answer.known) return;
        // The logit is negated, because near 0 the small share has full precision.
        const float fall = 2.0f * Share<float>(-answer.theta[0]).value, power = answer.scale * unit;
        figures_.relaxation_fall = fall;
        figures_.relaxation_variance = Share<float>(answer.theta[1]).value * power / (fall * (2.0f - fall));
        figures_.relaxation_R = Share<float>(-answer.theta[1]).value * power;
    }

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
