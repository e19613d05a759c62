// What a fit on the device says of an axis, and what is kept from it for the next one.
#ifndef FLTEA_FIT_MEMORY_HPP
#define FLTEA_FIT_MEMORY_HPP

#include "order_interval.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// What the fit says of the fractional model, and of the noise.
enum class Verdict : int {
    none,        // no fit yet, or nothing to fit
    white,       // white noise is not rejected
    fractional,  // and AR(1) is worse by more than 6 in 2 log L
    relaxation,  // AR(1) describes it as well
};

struct FitFigures {
    Verdict verdict;
    // Of white noise all of them are 0, but R and the relaxation's.
    // alpha_std: α ± 1.96 of it holds the 95 % interval of the likelihood; 0 if it is not known.
    float alpha, alpha_std;
    float g;            // h^α f
    float s2, R;        // in the squared unit of the bins' powers
    float ratio_white;  // 2 log L of orders up to 1 above white noise
    float ratio_ar1;    // 2 log L of the fractional model above AR(1)
    // The relaxation: 1 - φ, its variance, and that of the white noise with it.
    float relaxation_fall, relaxation_variance, relaxation_R;
    float ordinates;
    bool alpha_defined;  // the interval of α is not nearly all that is possible
};

template <class Bins>
class SlicedFit;

// What is kept of an axis from fit to fit: the answers are where the next one begins, and how far its looks
// around have come on the grid.
class FitMemory {
  public:
    // turn: which of twelve fits looks around, so that those of several axes need not be in the same round.
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
        unsigned char look;  // the place on the grid to look at next
    };
    void note_relaxation(float unit) {
        const Answer& answer = answers_[kRelaxation];
        if (!answer.known) return;
        // Near 0 the logit's other side has all digits.
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
