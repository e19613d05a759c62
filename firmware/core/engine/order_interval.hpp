// Computes the 95 % interval of the order α from the whole likelihood, and not only from its curvature at the
// maximum. Where the noise of that order is weak, the likelihood may have a second maximum or fall off
// slowly, which the curvature at the maximum does not show.
//
// An end of the interval is an order for which even the best choice of the other parameters gives a 2 log L
// that is 3.84 below the overall maximum. The ends move little from one fit to the next. A fit therefore does
// only one of two things: it corrects one end of the previous interval, or it tests one order farther away,
// in case the likelihood rises again there.
#ifndef FLTEA_ORDER_INTERVAL_HPP
#define FLTEA_ORDER_INTERVAL_HPP

#include "real_math.hpp"
#include "whittle_scoring.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

// Returns the standard deviation of the order that follows from the curvature of the likelihood, when the
// other free parameters are estimated together with the order. Returns 0 if the curvature gives no standard
// deviation.
inline float order_std(const Point<float>& best) {
    Point<float> unit = best;
    float column[3] = {0, 0, 0};
    const bool given[3] = {false, false, false};
    for (int i = 0; i < 3; ++i) unit.gradient[i] = i == 0 ? -1.0f : 0.0f;
    solve(unit, given, 3, 0.0f, column);
    return math::finite(column[0]) && column[0] > 0 ? math::sqrt(column[0]) : 0.0f;
}

// The ends of the order's 95 % interval, which are kept from one fit to the next.
struct OrderEnds {
    struct End {
        float order;
        float theta[2];  // the other free parameters that fit best with this order
    };
    End ends[2];
    bool known;
    // `turn`: counts fits; OrderInterval::begin() takes from it which of four steps the next fit does.
    // `look`: index of the distance from the best order at which an order was last tested (begin_look())
    unsigned char turn, look;
};

// Finds the 95 % interval of the order. How to use it: call forget() when a fit begins, note() for each point
// at which a search of the fit ended, and begin() with the best of all points. Then evaluate each point that
// propose() returns, and pass it to judge().
class OrderInterval {
  public:
    void forget() { noted_ = 0; }

    // Notes a point at which a search ended. If the likelihood there is nearly that of the best point, the
    // interval has to contain the point's order.
    void note(const Point<float>& point) {
        if (noted_ == kNotes) return;
        notes_[noted_].nll = point.nll;
        for (int i = 0; i < 3; ++i) notes_[noted_].theta[i] = point.theta[i];
        ++noted_;
    }

    // Begins to compute the interval. `best`: the best point of the fit. `half`: half the width of the
    // interval that follows from the curvature of the likelihood, or 0 if the curvature gives none. `ends`:
    // ends of the previous fit's interval.
    void begin(const Point<float>& best, float half, OrderEnds& ends) {
        order_ = best.theta[0];
        best_nll_ = best.nll;
        ends_ = &ends;
        // If the best order is outside of the previous fit's interval, the ends of that interval are of no
        // use.
        if (ends.known && !(ends.ends[0].order <= order_ && order_ <= ends.ends[1].order)) ends.known = false;
        most_ = ends.known ? 1 : int(kOrders);
        for (int side = 0; side < 2; ++side) {
            OrderEnds::End& end = ends.ends[side];
            const float sign = side == 0 ? -1.0f : 1.0f;
            if (!ends.known) {
                const float reach = half > 0 ? math::fmin(half, kLongest) : kLongest;
                set(end, order_ + sign * reach, best.theta);
            } else if (sign * (end.order - order_) < kShortest) {
                end.order = within(order_ + sign * kShortest);
            }
            for (int i = 0; i < noted_; ++i) {
                const bool outside = sign * (notes_[i].theta[0] - end.order) > 0;
                if (outside && notes_[i].nll < best_nll_ + kCritical)
                    set(end, notes_[i].theta[0], notes_[i].theta);
            }
        }
        // If there is a previous interval, four consecutive fits take turns: they correct the lower end, test
        // another order (begin_look()), correct the upper end, and test another order. Otherwise this fit
        // finds both ends.
        const int turn = ends.known ? ends.turn++ % 4 : -1;
        side_ = turn < 0 ? 0 : turn % 2 == 1 ? 2 : turn / 2;
        last_ = turn < 0 ? 1 : side_;
        ends.known = true;
        begin_side();
        if (side_ == 2) begin_look();
    }

    // Writes the next point to evaluate, and the model for it. Returns false when no point is left.
    bool propose(Model<float>& model, Point<float>& next) {
        while (side_ <= last_) {
            OrderEnds::End& end = at();
            model.hold = kHoldOrder;
            model.held = end.order;
            if (!begun_) {
                for (int i = 0; i < 2; ++i) next.theta[i] = end.theta[i];
                next.theta[2] = 0;
                search_ = Search<float>(model);
                return true;
            }
            const Patience<float> until = {kSteps, kTolerance, -Room<float>::impossible(),
                                           best_nll_ + kFarOutside};
            if (search_.propose(model, until, now_, next)) return true;
            if (side_ < 2) {
                concluded(end);
            } else {
                looked();
            }
        }
        return false;
    }

    void judge(const Point<float>& next) {
        if (begun_) {
            search_.judge(next, now_);
        } else {
            now_ = next;
            begun_ = true;
        }
    }

    // Whether the point that was tested last fits better than the best point. If so, a new search should
    // start at `point`.
    bool better(Point<float>& point) const {
        if (!begun_ || !(now_.nll < best_nll_ - kWorthASearch)) return false;
        point.theta[0] = side_ < 2 ? ends_->ends[side_].order : elsewhere_.order;
        for (int i = 0; i < 2; ++i) point.theta[1 + i] = now_.theta[i];
        return true;
    }

    // Returns the distance from the best order to the farther end of the interval.
    float half() const { return math::fmax(order_ - ends_->ends[0].order, ends_->ends[1].order - order_); }

  private:
    enum { kNotes = 8, kOrders = 6, kLooks = 8, kSteps = 6 };
    static constexpr float kCritical = 1.92f, kRoot = 1.3856406f, kTolerance = 0.02f, kFarOutside = 6.0f,
                           kLongest = 0.3f, kShortest = 1e-3f, kWorthASearch = 0.05f, kHighest = 1.99999f;

    static float within(float order) { return math::fmin(math::fmax(order, 0.0f), kHighest); }

    static void set(OrderEnds::End& end, float order, const float* theta) {
        end.order = within(order);
        for (int i = 0; i < 2; ++i) end.theta[i] = theta[1 + i];
    }

    void begin_side() {
        inside_ = order_;
        inside_root_ = 0;
        bracketed_ = begun_ = false;
        tried_ = 0;
    }

    // Estimates the end of the interval anew. If -log L is a parabola in the order, the square root of its
    // rise above the minimum is a straight line. The end is therefore found by linear interpolation of this
    // root between an order inside and an order outside of the interval, or by extrapolation from one order.
    void concluded(OrderEnds::End& end) {
        for (int i = 0; i < 2; ++i) end.theta[i] = now_.theta[i];
        const float below = math::fmin(math::fmax(now_.nll - best_nll_, 0.0f), 20.0f);
        const float root = math::sqrt(below), looked_at = end.order;
        if (root < kRoot) {
            inside_ = looked_at;
            inside_root_ = root;
        } else {
            outside_ = looked_at;
            outside_root_ = root;
            bracketed_ = true;
        }
        if (bracketed_) {
            end.order =
                inside_ + (outside_ - inside_) * (kRoot - inside_root_) / (outside_root_ - inside_root_);
        } else {
            const float ratio = kRoot / math::fmax(root, 0.5f * kRoot);
            end.order = within(order_ + (looked_at - order_) * ratio);
        }
        begun_ = false;
        const bool near = math::fabs(root - kRoot) < 0.1f * kRoot;
        if (++tried_ == most_ || near || end.order == looked_at) {
            ++side_;
            begin_side();
        }
    }

    OrderEnds::End& at() { return side_ < 2 ? ends_->ends[side_] : elsewhere_; }

    void begin_look() {
        static const float away[kLooks] = {-0.15f, 0.15f, -0.3f, 0.3f, -0.45f, 0.45f, -0.6f, 0.6f};
        ends_->look = static_cast<unsigned char>((ends_->look + 1) % kLooks);
        const int side = ends_->look % 2;
        elsewhere_ = ends_->ends[side];
        elsewhere_.order = within(order_ + away[ends_->look]);
    }

    void looked() {
        OrderEnds::End& end = ends_->ends[elsewhere_.order < order_ ? 0 : 1];
        const bool outside =
            elsewhere_.order < order_ ? elsewhere_.order < end.order : elsewhere_.order > end.order;
        if (outside && now_.nll < best_nll_ + kCritical) {
            end.order = elsewhere_.order;
            for (int i = 0; i < 2; ++i) end.theta[i] = now_.theta[i];
        }
        begun_ = false;
        ++side_;
    }

    struct Note {
        float theta[3], nll;
    };
    Note notes_[kNotes];
    int noted_ = 0;
    OrderEnds* ends_ = nullptr;
    OrderEnds::End elsewhere_;
    Point<float> now_;
    Search<float> search_ = Search<float>(Model<float>{kFractional, 2.0f, kHoldOrder, 1.0f, 0, 0});
    float order_, best_nll_, inside_, inside_root_, outside_, outside_root_;
    int side_ = 2, last_ = 1, tried_, most_;
    bool begun_ = false, bracketed_;
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
