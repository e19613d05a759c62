// The device's Whittle fits. They run in float, a few bins of the spectrum at a time, so that sampling never
// waits for them. The models, their derivatives and the scoring are compiled from the same sources as on the
// host (whittle_models.hpp, whittle_shapes.hpp, whittle_scoring.hpp).
#ifndef FLTEA_SLICED_FIT_HPP
#define FLTEA_SLICED_FIT_HPP

#include "fit_grid.hpp"
#include "fit_memory.hpp"
#include "null_quantiles.hpp"
#include "sliced_target.hpp"
#include "whittle_scoring.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// A fit of the noise of one axis: call begin(), then work() until it returns true.
template <class Bins>
class SlicedFit {
  public:
    enum { kBinsAtOnce = 4 };

    SlicedFit() : memory_(nullptr), busy_(false), searched_(false) {}

    bool busy() const { return busy_; }
    // Number of evaluations of the likelihood in the last fit.
    int evaluations() const { return evaluations_; }
    // Whether the last fit had no previous fit's answer to start from, so that it began with a search on a
    // grid.
    bool searched() const { return searched_; }

    // Begins a fit. `level`: significance level of the null test. Neither the bins nor `memory` may change
    // until the fit is done; after that, `memory` has the results. If the bins contain no ordinates or no
    // power, the fit is done at once, without a result.
    void begin(const Bins& bins, NullLevel level, FitMemory& memory) {
        memory_ = &memory;
        level_ = level;
        searched_ = false;
        evaluations_ = 0;
        busy_ = bins.ordinates() > 0 && bins.mean_power() > 0;
        if (!busy_) {
            memory.figures_ = FitFigures();
            return;
        }
        target_.begin(bins);
        // The answer of a previous fit to far fewer ordinates is no useful starting point.
        if (bins.ordinates() > kMuchMore * memory.fitted_ordinates_) {
            for (Answer& one : memory.answers_) one.known = false;
            memory.ends_.known = false;
            searched_ = true;
            memory.fitted_ordinates_ = bins.ordinates();
        } else {
            memory.turn_ = (memory.turn_ + 1) % kTurns;
        }
        which_ = kWhiteNoise;
        settled_ = 0;
        searches_again_ = bounding_ = false;
        interval_.forget();
        begin_model();
    }

    // Evaluates the likelihood at a few more bins of the spectrum. Returns true when the fit is done.
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
    enum { kKept = 3, kGridSteps = 40, kWarmSteps = 10, kTogether = 4, kLooks = 5, kTurns = 12 };

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

    // Begins the fit of the next model. If no previous fit has an answer for this model, all points of a grid
    // are evaluated approximately, and the best ones are starting points. Otherwise the previous answer is
    // the starting point. Every twelfth fit also tests some points of the grid, different ones each time, in
    // case the maximum has moved.
    void begin_model() {
        model_ = model_of(which_);
        target_.begin_model();
        cold_ = !memory_->answers_[which_].known;
        starts_ = rough_ = 0;
        as_before_ = -Room<float>::impossible();
        for (Point<float>& one : kept_) one.nll = Room<float>::impossible();
        best_.nll = Room<float>::impossible();
        // The model kFull allows every order, kUpToOne only orders up to 1. If the best order is below 1,
        // both have the same answer. So if kFull ended below 1 in the last fit, and kUpToOne ended below 1 in
        // this fit, the answer of kUpToOne replaces the first search for kFull.
        from_before_ = which_ == kFull && !cold_ && memory_->answers_[kFull].theta[0] < 1.0f &&
                       up_to_one_.theta[0] < kBelowOne;
        if (which_ == kWhiteNoise) {
            evaluate_next();
        } else if (rough_ < rough_size()) {
            rough_point(next_);
            evaluate_next();
        } else {
            begin_search();
        }
    }

    int grid_size() const {
        return which_ == kRelaxation ? int(FitGrid::kOfRelaxation)
               : which_ == kUpToOne  ? int(FitGrid::kOfOrdersUpToOne)
               : which_ == kFull     ? int(FitGrid::kOfOrdersAbove)
                                     : 0;
    }
    int rough_size() const {
        return cold_ ? grid_size() : which_ == kFull || grid_size() == 0 || !looks_around() ? 0 : 1 + kLooks;
    }

    void rough_point(Point<float>& point) const {
        const Answer& answer = memory_->answers_[which_];
        if (cold_) {
            grid_point(rough_, point);
        } else if (rough_ == 0) {
            start_at(last_answer(), point);
        } else {
            grid_point((answer.look + rough_ - 1) % grid_size(), point);
        }
        canonical(model_, point.theta);
    }

    // The grid of kFull has only orders above 1, and the grid of kUpToOne has the others. For orders up to 1,
    // a search for kFull can start at the answer of kUpToOne (next_start()).
    void grid_point(int place, Point<float>& point) const {
        if (which_ == kRelaxation) {
            FitGrid::relaxation(place, point.theta);
        } else {
            FitGrid::order(which_ == kFull ? place + int(FitGrid::kOfOrdersUpToOne) : place, point.theta);
        }
    }

    const Answer& last_answer() const { return memory_->answers_[from_before_ ? kUpToOne : which_]; }

    static void start_at(const Answer& answer, Point<float>& point) {
        for (int i = 0; i < 3; ++i) point.theta[i] = answer.theta[i];
    }

    void evaluate_next() {
        next_.nll = Room<float>::impossible();
        next_.scale = 1.0f;
        possible_ = map(model_, next_.theta, at_);
        target_.begin_sums(rough_ < rough_size() ? int(kTogether) : 1);
        again_ = false;
    }

    // Chooses the next starting point of a search. The best grid points or the previous fit's answer come
    // first. The answer of the next simpler model, a special case of this one, comes last. If there is a
    // previous answer, the simpler model's answer is used only if it is better than the searches so far.
    bool next_start(Point<float>& point) {
        const int own = cold_ ? int(kKept) : 2;
        while (starts_ < own) {
            const int number = starts_++;
            if (from_before_ && number == 0) {
                best_ = up_to_one_;
                continue;
            }
            if (!cold_ && number == 0) {
                start_at(last_answer(), point);
                return true;
            }
            const Point<float>& kept = kept_[cold_ ? number : 0];
            if (kept.nll < (cold_ ? Room<float>::impossible() : as_before_ + kWorthALook)) {
                point = kept;
                return true;
            }
        }
        if (from_before_ && starts_++ == own && looks_around()) {
            // If a relaxation (order 1) fits nearly as well as the best order below 1, orders above 1 may fit
            // too, so one more search starts above 1.
            const Answer& relaxation = memory_->answers_[kRelaxation];
            if (relaxation.nll > best_.nll + kNearly) return false;
            start_at_relaxation(kAboveOne, point);
            return true;
        }
        if (from_before_ || starts_++ > own || which_ == kRelaxation) return false;
        const Answer& before = memory_->answers_[which_ - 1];
        if (!before.known || (!cold_ && before.nll >= best_.nll - kTolerance)) return false;
        if (which_ == kFull) {
            start_at(before, point);
        } else {
            start_at_relaxation(1.0f, point);
        }
        return true;
    }

    // An AR(1) with the coefficient φ is the fractional model of order 1 with the feedback g = φ - 1.
    void start_at_relaxation(float order, Point<float>& point) const {
        const Answer& relaxation = memory_->answers_[kRelaxation];
        const Share<float> share(relaxation.theta[0]);
        point.theta[0] = order;
        point.theta[1] = logit(math::fmin(math::fmax(1.0f - share.value, 1e-6f), 1.0f - 1e-6f));
        point.theta[2] = relaxation.theta[1];
    }

    bool looks_around() const { return memory_->turn_ == 0; }

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

    // Handles the result of a finished evaluation of the likelihood.
    void judged() {
        if (bounding_) {
            interval_.judge(next_);
            bound();
            return;
        }
        if (which_ == kWhiteNoise || settled_ > 0) {
            best_ = next_;
            end_model();
            return;
        }
        if (rough_ < rough_size()) {
            if (cold_ || rough_ > 0) {
                keep();
            } else {
                as_before_ = next_.nll;
            }
            if (++rough_ < rough_size()) {
                rough_point(next_);
                evaluate_next();
            } else {
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
        const Patience<float> until = {cold_ ? kGridSteps : kWarmSteps, kTolerance,
                                       -Room<float>::impossible(), Room<float>::impossible()};
        if (search_.propose(model_, until, now_, next_)) {
            evaluate_next();
            return;
        }
        if (which_ == kUpToOne || which_ == kFull) interval_.note(now_);
        if (now_.nll < best_.nll) best_ = now_;
        begin_search();
    }

    // Whether the best scale of the spectrum differs by more than a tenth from reference(), for which the
    // sums were computed. -log L then has too few digits, as it is a difference of two large sums.
    // Approximate evaluations do not need these digits.
    bool far() const {
        const float apart = next_.scale / target_.reference() - 1.0f;
        return rough_ >= rough_size() && (apart > 0.1f || apart < -0.1f);
    }

    void keep() {
        int place = kKept;
        while (place > 0 && next_.nll < kept_[place - 1].nll) --place;
        if (place == kKept) return;
        for (int i = kKept - 1; i > place; --i) kept_[i] = kept_[i - 1];
        kept_[place] = next_;
    }

    void keep_answer(Which which) {
        if (which == kUpToOne) up_to_one_ = best_;
        Answer& answer = memory_->answers_[which];
        for (int i = 0; i < 3; ++i) answer.theta[i] = best_.theta[i];
        answer.nll = best_.nll;
        answer.scale = best_.scale;
        answer.known = best_.nll < Room<float>::impossible();
    }

    void end_model() {
        keep_answer(which_);
        // kFull may have found a better point below order 1 than kUpToOne did. That point is then the answer
        // of kUpToOne, too. This happens after a second search for kFull, which bound() starts where the
        // computation of the interval has come upon a better order.
        if (which_ == kFull && best_.theta[0] < kBelowOne && best_.nll < up_to_one_.nll)
            keep_answer(kUpToOne);
        Answer& answer = memory_->answers_[which_];
        if (!cold_ && rough_size() > 0) {
            answer.look = static_cast<unsigned char>((answer.look + kLooks) % grid_size());
        }
        target_.refer_to(answer.known ? answer.scale : 1.0f);
        // Evaluates the best point again, to make its derivatives more precise. They are stored as
        // differences from their means in the evaluation before. If that evaluation was at a point far from
        // the best one, the differences are large and lose digits.
        if (which_ == kFull && answer.known && (cold_ || looks_around()) && settled_ < 2) {
            ++settled_;
            next_ = best_;
            evaluate_next();
            return;
        }
        if (which_ == kFull) {
            if (memory_->report(model_, level_, target_.ordinates, target_.unit())) {
                begin_interval();
            } else {
                memory_->ends_.known = busy_ = false;
            }
            return;
        }
        which_ = static_cast<Which>(which_ + 1);
        begin_model();
    }

    void begin_interval() {
        curvature_std_ = order_std(best_);
        interval_.begin(best_, k95 * curvature_std_, memory_->ends_);
        bounding_ = true;
        bound();
    }

    // Continues with the interval of the order: evaluates one order after the other until both ends are
    // known.
    void bound() {
        if (!searches_again_ && interval_.better(next_)) {
            searches_again_ = true;
            bounding_ = searching_ = false;
            settled_ = 0;
            model_ = model_of(kFull);
            memory_->ends_.known = false;
            search_ = Search<float>(model_);
            evaluate_next();
            return;
        }
        if (interval_.propose(model_, next_)) return evaluate_next();
        FitFigures& f = memory_->figures_;
        f.alpha_std = curvature_std_ > 0 ? math::fmax(curvature_std_, interval_.half() / k95) : 0.0f;
        f.alpha_defined = f.alpha_std > 0 && 2.0f * k95 * f.alpha_std < 0.9f * 2.0f;
        busy_ = false;
    }

    static constexpr float kTolerance = 3e-4f, kMuchMore = 4.0f, kBelowOne = 0.99f, kNearly = 3.0f,
                           kWorthALook = 20.0f, kAboveOne = 1.2f, k95 = 1.96f;

    SlicedTarget<Bins> target_;
    FitMemory* memory_;
    Model<float> model_;
    Mapped<float> at_;
    Point<float> next_, now_, best_, up_to_one_, kept_[kKept];
    Search<float> search_ = Search<float>(model_of(kUpToOne));
    OrderInterval interval_;
    float curvature_std_;  // standard deviation of α that follows from the curvature of the likelihood
    NullLevel level_;
    Which which_;
    float as_before_;  // -log L of the last fit's answer, computed approximately from the bins of this fit
    int rough_, starts_, settled_, evaluations_;
    bool busy_, cold_, from_before_, searching_, possible_, again_, searched_, bounding_, searches_again_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
