// Whittle fits in float, a few bins at a time, so that sampling never waits for them: the device's. The
// models, their slopes and the scoring are the host's (whittle_models.hpp, whittle_shapes.hpp,
// whittle_scoring.hpp).
#ifndef FLTEA_SLICED_FIT_HPP
#define FLTEA_SLICED_FIT_HPP

#include "null_quantiles.hpp"
#include "sliced_target.hpp"
#include "whittle_scoring.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// What the fit says of the fractional model, and of the noise.
enum class Verdict : int {
    none,        // no fit yet
    white,       // white noise is not rejected
    fractional,  // and AR(1) is worse by more than 6 in 2 log L
    relaxation,  // AR(1) describes it as well
};

struct FitFigures {
    Verdict verdict;
    float alpha, alpha_std;
    float g;            // h^α f
    float s2, R;        // in the squared unit of the bins' powers
    float ratio_white;  // 2 log L of orders up to 1 above white noise
    float ratio_ar1;    // 2 log L of the fractional model above AR(1)
    float ordinates;
    bool alpha_defined;  // the interval of α is not nearly all that is possible
};

// What is kept of an axis from fit to fit: the answers are where the next one begins.
class FitMemory {
  public:
    FitMemory() : figures_(), fitted_ordinates_(0) {
        for (Answer& one : answers_) one.known = false;
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
    };
    Answer answers_[kModels];
    FitFigures figures_;
    float fitted_ordinates_;
};

// A fit: begin(), then work() until it is done.
template <class Bins>
class SlicedFit {
  public:
    enum { kBinsAtOnce = 4 };

    SlicedFit() : memory_(nullptr), busy_(false), searched_(false) {}

    bool busy() const { return busy_; }
    // Evaluations of the last fit.
    int evaluations() const { return evaluations_; }
    // It began on a grid.
    bool searched() const { return searched_; }

    // `level` of the null test. Neither the bins nor the memory may change until it is done; the figures are
    // there then.
    void begin(const Bins& bins, NullLevel level, FitMemory& memory) {
        busy_ = true;
        memory_ = &memory;
        level_ = level;
        target_.begin(bins);
        searched_ = false;
        // Answers that have seen far less lead nowhere.
        if (bins.ordinates() > kMuchMore * memory.fitted_ordinates_) {
            for (Answer& one : memory.answers_) one.known = false;
            searched_ = true;
            memory.fitted_ordinates_ = bins.ordinates();
        }
        evaluations_ = 0;
        which_ = kWhiteNoise;
        begin_model();
    }

    // A slice. True when the fit is done.
    bool work(const Bins& bins) {
        if (!busy_) return true;
        if (possible_ && !target_.add(bins, model_.family, at_.natural, kBinsAtOnce)) return false;
        ++evaluations_;
        if (possible_) {
            Sums<float> sums;
            target_.read(model_.family, sums);
            conclude(target_, model_, at_, sums, next_);
            if (far() && !again_) {
                again_ = true;
                target_.refer_to(next_.scale);
                target_.begin_sums();
                return false;
            }
        }
        judged();
        return !busy_;
    }

  private:
    typedef FitMemory::Which Which;
    typedef FitMemory::Answer Answer;
    static constexpr Which kWhiteNoise = FitMemory::kWhiteNoise, kRelaxation = FitMemory::kRelaxation,
                           kUpToOne = FitMemory::kUpToOne, kFull = FitMemory::kFull;
    enum { kKept = 3, kGridSteps = 40, kWarmSteps = 10, kTogether = 4 };

    static Model<float> model_of(Which which) {
        const Model<float> model = {which == kWhiteNoise   ? kWhite
                                    : which == kRelaxation ? kAr1
                                                           : kFractional,
                                    which == kUpToOne ? 1.0f : 2.0f,
                                    kNothing,
                                    0,
                                    0,
                                    0};
        return model;
    }

    void begin_model() {
        model_ = model_of(which_);
        starts_ = 0;
        // The best order up to 1 is a start of the full model.
        grid_ = which_ == kFull ? kUpToOneGrid : 0;
        for (Point<float>& one : kept_) one.nll = Room<float>::impossible();
        best_.nll = Room<float>::impossible();
        on_grid_ = !memory_->answers_[which_].known && grid_size() > 0;
        // Where the best order is below 1 orders above 1 add nothing until the grid is searched again.
        if (which_ == kFull && !on_grid_ && memory_->answers_[kFull].theta[0] < 1.0f) {
            best_ = up_to_one_;
            end_model();
            return;
        }
        if (which_ == kWhiteNoise) {
            evaluate_next();
        } else if (on_grid_) {
            grid_point(next_);
            evaluate_next();
        } else {
            begin_search();
        }
    }

    int grid_size() const { return which_ == kRelaxation ? 24 : which_ == kWhiteNoise ? 0 : kFractionalGrid; }

    void grid_point(Point<float>& point) const {
        static const float poles[] = {-2.2f, -0.5f, 0.5f, 1.4f, 2.6f, 3.7f, 5.0f, 7.6f};  // logits
        static const float weights[] = {-6.9f, -2.9f, -0.4f};
        static const float orders[] = {0.15f, 0.45f, 0.75f, 1.0f, 1.3f, 1.75f};
        static const float shares[] = {-7.0f, -4.6f, -2.4f, -0.6f, 1.4f, 3.0f};
        point.theta[2] = 0;
        if (which_ == kRelaxation) {
            point.theta[0] = poles[grid_ / 3];
            point.theta[1] = weights[grid_ % 3];
        } else {
            point.theta[0] = orders[grid_ / 18];
            point.theta[1] = shares[grid_ / 3 % 6];
            point.theta[2] = weights[grid_ % 3];
        }
        canonical(model_, point.theta);
    }

    void evaluate_next() {
        next_.nll = Room<float>::impossible();
        next_.scale = 1.0f;
        possible_ = map(model_, next_.theta, at_);
        target_.begin_sums(on_grid_ && grid_ < grid_size() ? int(kTogether) : 1);
        again_ = false;
    }

    // The start that comes now: of what the grid has kept, or the last answer; then what the models before
    // say.
    bool next_start(Point<float>& point) {
        const int own = on_grid_ ? int(kKept) : 1, number = starts_++;
        if (number < own) {
            if (on_grid_) {
                point = kept_[number];
                return point.nll < Room<float>::impossible() || next_start(point);
            }
            for (int i = 0; i < 3; ++i) point.theta[i] = memory_->answers_[which_].theta[i];
            return true;
        }
        if (number > own || which_ == kRelaxation || !on_grid_) return false;
        if (which_ == kFull) {
            for (int i = 0; i < 3; ++i) point.theta[i] = memory_->answers_[kUpToOne].theta[i];
        } else {  // AR(1) is the fractional model of order 1, with g = φ - 1
            const Share<float> share(memory_->answers_[kRelaxation].theta[0]);
            point.theta[0] = 1.0f;
            point.theta[1] = logit(math::fmin(math::fmax(1.0f - share.value, 1e-6f), 1.0f - 1e-6f));
            point.theta[2] = memory_->answers_[kRelaxation].theta[1];
        }
        return true;
    }

    void begin_search() {
        if (!next_start(next_)) {
            end_model();
            return;
        }
        canonical(model_, next_.theta);
        search_ = Search<float>(model_);
        searching_ = false;
        evaluate_next();
    }

    // An evaluation is there.
    void judged() {
        if (which_ == kWhiteNoise) {
            best_ = next_;
            end_model();
            return;
        }
        if (grid_ < grid_size() && on_grid_) {
            keep();
            if (++grid_ < grid_size() && !beyond()) {
                grid_point(next_);
                evaluate_next();
            } else {
                grid_ = grid_size();
                begin_search();
            }
            return;
        }
        if (!searching_) {
            now_ = next_;
            searching_ = true;
        } else {
            search_.judge(next_, now_);
        }
        const Patience<float> until = {on_grid_ ? kGridSteps : kWarmSteps, kTolerance,
                                       -Room<float>::impossible(), Room<float>::impossible()};
        if (search_.propose(model_, until, now_, next_)) {
            evaluate_next();
            return;
        }
        if (now_.nll < best_.nll) best_ = now_;
        begin_search();
    }

    // The scale is so far from the reference that the two parts of -log L take each other's digits away. On
    // the grid that does not matter.
    bool far() const {
        const float apart = next_.scale / target_.reference() - 1.0f;
        return grid_ >= grid_size() || !on_grid_ ? apart > 0.1f || apart < -0.1f : false;
    }

    // Orders above 1 are on the grid of the full model only, and no others.
    bool beyond() const { return which_ == kUpToOne && grid_ >= kUpToOneGrid; }

    void keep() {
        int place = kKept;
        while (place > 0 && next_.nll < kept_[place - 1].nll) --place;
        if (place == kKept) return;
        for (int i = kKept - 1; i > place; --i) kept_[i] = kept_[i - 1];
        kept_[place] = next_;
    }

    void end_model() {
        if (which_ == kUpToOne) up_to_one_ = best_;
        Answer& answer = memory_->answers_[which_];
        for (int i = 0; i < 3; ++i) answer.theta[i] = best_.theta[i];
        answer.nll = best_.nll;
        answer.scale = best_.scale;
        answer.known = best_.nll < Room<float>::impossible();
        target_.refer_to(answer.known ? answer.scale : 1.0f);
        if (which_ == kFull) {
            report();
            busy_ = false;
            return;
        }
        which_ = static_cast<Which>(which_ + 1);
        begin_model();
    }

    void report() {
        FitFigures& f = memory_->figures_;
        Mapped<float> at;
        map(model_, best_.theta, at);
        const float power = best_.scale * target_.unit();
        f.alpha = at.natural.shape[0];
        f.g = at.natural.shape[1];
        f.s2 = at.natural.variance[0] * power;
        f.R = at.natural.white * power;
        f.ordinates = target_.ordinates;
        f.ratio_white = 2.0f * (memory_->answers_[kWhiteNoise].nll - memory_->answers_[kUpToOne].nll);
        f.ratio_ar1 = 2.0f * (memory_->answers_[kRelaxation].nll - best_.nll);
        const bool white = f.ratio_white < null_quantile(level_, f.ordinates);
        f.verdict = white ? Verdict::white : f.ratio_ar1 > kApart ? Verdict::fractional : Verdict::relaxation;
        // Of α, by the information that the other coordinates leave.
        Point<float> unit = best_;
        float column[3] = {0, 0, 0};
        const bool given[3] = {false, false, false};
        for (int i = 0; i < 3; ++i) unit.gradient[i] = i == 0 ? -1.0f : 0.0f;
        solve(unit, given, 3, 0.0f, column);
        f.alpha_std = math::sqrt(column[0]);
        f.alpha_defined = !white && 2.0f * 1.96f * f.alpha_std < 0.9f * 2.0f;
    }

    static constexpr float kTolerance = 3e-4f, kApart = 6.0f, kMuchMore = 4.0f;
    enum { kFractionalGrid = 6 * 18, kUpToOneGrid = 4 * 18 };

    SlicedTarget<Bins> target_;
    FitMemory* memory_;
    Model<float> model_;
    Mapped<float> at_;
    Point<float> next_, now_, best_, up_to_one_, kept_[kKept];
    Search<float> search_ = Search<float>(model_of(kUpToOne));
    NullLevel level_;
    Which which_;
    int grid_, starts_, evaluations_;
    bool busy_, on_grid_, searching_, possible_, again_, searched_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
