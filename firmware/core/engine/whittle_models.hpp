// The free parameters of the fitted spectra (the same as in host/native/whittle_kernel.hpp). A part's
// proportion of the power and a pole are represented by logits, and a variance by its logarithm. These may
// have any value, so only the order has bounds that a fit comes upon. One number of the fractional model may
// be held fixed while the other numbers are fitted.
#ifndef FLTEA_WHITTLE_MODELS_HPP
#define FLTEA_WHITTLE_MODELS_HPP

#include "real_math.hpp"
#include "whittle_numbers.hpp"

namespace fltea {
namespace whittle {

// Which number of the fractional model is held fixed: the order α, the feedback g, the parameter f = h^-α g,
// the weight F = g + α with which the previous sample enters the next one, the variance of the state, or the
// variance of the white noise.
enum Hold : int { kNothing, kHoldOrder, kHoldFeedback, kHoldParameter, kHoldWeight, kHoldState, kHoldNoise };

template <class R>
struct Model {
    Family family;
    R highest_order;  // highest order α of the fractional model
    Hold hold;
    R held;       // value at which the number named by `hold` is fixed
    R log_h;      // log of the sampling period; only needed if `hold` fixes the parameter f
    R log_power;  // log of the approximate power of the data; only needed if `hold` fixes a variance
};

const double kSmallest = 1e-7;  // smallest magnitude of the feedback g, divided by its largest, 2^α
const double kTop = 16.0;       // largest magnitude of the logit of a proportion or pole
const double kBelowHighest = 1e-6;
// Limits of log c, where √c is the corner frequency of a low-pass [rad per sample]. They allow corners from a
// millionth of the sample rate to three times the Nyquist frequency. With the highest corner, only the
// beginning of the low-pass's slope is visible.
const double kLowestCorner = -24.0, kHighestCorner = 4.5;
const double kMostPolesOfFilter = 24.0;
// Limits of the order d of the model ARFIMA (fractionally integrated noise). They exclude white noise (0) and
// the random walk (1).
const double kLeastDifference = 0.15, kMostDifference = 0.85;

template <class R>
struct Share {
    R value, slope;
    explicit Share(R parameter) {
        value = 1 / (1 + math::exp(-parameter));
        slope = value * (1 - value);
    }
};

template <class R>
R logit(R share) {
    return math::log(share / (1 - share));
}

template <class R>
int free_of(const Model<R>& model) {
    switch (model.family) {
        case kFractional:
            return model.hold == kNothing || model.hold == kHoldState || model.hold == kHoldNoise ? 3 : 2;
        case kAr2:
            return 3;
        default:
            return shapes(model.family) + parts(model.family);
    }
}

// Whether the scale of the spectrum is free. A free scale is not searched for: the best scale is computed in
// closed form.
template <class R>
bool scaled(const Model<R>& model) {
    return model.hold != kHoldState && model.hold != kHoldNoise;
}

// Returns the lowest order α at which the fractional model can have the weight F = g + α, with which the
// previous sample enters the next one. The feedback g has to be between -2^α and 0. This means α > F and α -
// 2^α < F.
//
// The second condition holds for every order if F > -0.914, the maximum of α - 2^α. Otherwise it holds above
// a certain order, which is returned. If also F > -1, it holds for some orders near 0, too. These are left
// out: their models are white noise or AR(1), which orders near 1 with the same F describe as well.
template <class R>
R lowest_order(R F) {
    if (F > R(-0.9139)) return math::fmax(F, R(0));
    R low = R(0.52876637), high = 2;
    for (int i = 0; i < 30; ++i) {
        const R middle = (low + high) / 2;
        (middle - math::exp2(middle) > F ? low : high) = middle;
    }
    return high + R(kBelowHighest);
}

// Whether the first free parameter is α. It is not if α is held fixed. If F = g + α is held fixed, it is log
// -g: g may be much smaller than F, and α = F - g would then contain too few digits of g.
template <class R>
bool order_first(const Model<R>& model) {
    return model.family == kFractional && model.hold != kHoldOrder && model.hold != kHoldWeight;
}

// Returns the middle of the range of free parameter i. Parameters are like the logit of a proportion p. Far
// below the middle, the logit is nearly log p of a small p. Far above, it is nearly -log(1 - p) of a small 1
// - p.
template <class R>
R centre(const Model<R>& model, int i) {
    return i == 2 && !scaled(model) ? model.log_power : 0;
}

// Writes the bounds of the free parameters.
template <class R>
void bounds(const Model<R>& model, R* low, R* high) {
    for (int i = 0; i < Room<R>::kFree; ++i) {
        low[i] = R(-kTop);
        high[i] = R(kTop);
    }
    // A sum of more than two AR(1) consists of relaxations, so no coefficient φ may be negative. A logit of 0
    // stands for φ = 0.
    if (!low_pass(model.family) && poles(model.family) > 2)
        for (int i = 0; i < poles(model.family); ++i) low[i] = 0;
    if (low_pass(model.family)) {
        low[0] = R(kLowestCorner);
        high[0] = R(kHighestCorner);
    }
    if (model.family != kFractional || model.hold == kHoldOrder) return;
    low[0] = 0;
    high[0] = model.highest_order - R(kBelowHighest);
    // If g or f is fixed at `held`, the model is stationary (-2^α < g < 0) only above a certain order α. That
    // order is the lower bound.
    if (model.hold == kHoldFeedback && model.held <= -1) low[0] = math::log2(-model.held) + R(kBelowHighest);
    if (model.hold == kHoldParameter && model.held <= -1 && model.log_h < 0)
        low[0] = math::log(-model.held) / (R(0.6931471805599453) - model.log_h) + R(kBelowHighest);
    if (model.hold == kHoldWeight) {  // the first free parameter is log -g (g: feedback)
        low[0] = math::log(math::fmax(lowest_order(model.held) - model.held, R(kSmallest)));
        high[0] = math::log(high[0] - model.held);
        return;
    }
    if (!scaled(model)) {
        low[2] = model.log_power - 25;
        high[2] = model.log_power + 5;
    }
    low[0] = math::fmin(low[0], high[0]);
}

// What determines a spectrum: its shapes (such as α and g) and its variances. If the scale is free, these are
// the variances at scale 1. `chain`: derivatives by the free parameters. A row has the derivatives of a
// shape, of the logarithm of a part's variance, or (last row) of the logarithm of the white noise's variance.
// A column belongs to a free parameter.
template <class R>
struct Mapped {
    Natural<R> natural;
    R chain[Most<R>::kNumbers][Room<R>::kFree];
};

template <class R>
void map_pole(R parameter, R& pole, R& slope) {
    const Share<R> share(parameter);
    pole = 2 * share.value - 1;
    slope = 2 * share.slope;
}

// Computes the two variances of a model with one part and white noise. They add up to 1. `coordinate`: logit
// of the part's variance, which is the last free parameter.
template <class R>
void map_weight(R parameter, int row, int column, Mapped<R>& out) {
    const Share<R> share(parameter);
    out.natural.variance[0] = share.value;
    out.natural.white = 1 - share.value;
    out.chain[row][column] = 1 - share.value;
    out.chain[row + 1][column] = -share.value;
}

// Computes the variances of several parts and of the white noise, whose sum is 1. Each part takes a
// proportion of what the parts before it have left, and the last parameters are the logits of these
// proportions. The white noise has the rest.
template <class R>
void map_shares(const R* theta, int shapes, int parts, Mapped<R>& out) {
    R rest = 1;
    for (int k = 0; k < parts; ++k) {
        const int column = shapes + k;
        const Share<R> share(theta[column]);
        out.natural.variance[k] = rest * share.value;
        rest *= 1 - share.value;
        out.chain[column][column] = 1 - share.value;
        for (int row = column + 1; row <= shapes + parts; ++row) out.chain[row][column] = -share.value;
    }
    out.natural.white = rest;
}

// Computes what determines the spectrum of the fractional model from its free parameters: the order α, the
// feedback g and the variances. Returns false if no spectrum has these parameters.
template <class R>
bool map_fractional(const Model<R>& model, const R* theta, Mapped<R>& out) {
    R& alpha = out.natural.shape[0];
    R& g = out.natural.shape[1];
    const bool order_held = model.hold == kHoldOrder;
    alpha = order_held ? model.held : theta[0];
    if (!order_held) out.chain[0][0] = 1;
    int next = 1;  // index of the next free parameter
    switch (model.hold) {
        case kHoldFeedback:
            g = model.held;
            break;
        case kHoldParameter:
            g = model.held * math::exp(alpha * model.log_h);
            out.chain[1][0] = g * model.log_h;
            break;
        case kHoldWeight:
            g = -math::exp(theta[0]);
            alpha = model.held - g;
            out.chain[0][0] = -g;
            out.chain[1][0] = g;
            break;
        default: {
            next = order_held ? 0 : 1;
            const Share<R> share(theta[next]);
            const R most = math::exp2(alpha);
            g = -most * share.value;
            if (!order_held) out.chain[1][0] = g * R(0.6931471805599453);
            out.chain[1][next] = -most * share.slope;
            ++next;
        }
    }
    const R most = math::exp2(alpha);
    if (!(alpha >= 0 && alpha <= 2 && g <= 0 && g >= -most * (1 - R(kSmallest) / 2))) return false;
    // A feedback g that is very close to 0 cannot be distinguished from 0 in a record. Its magnitude is kept
    // at kSmallest 2^α or more.
    g = math::fmin(g, -most * R(kSmallest));
    if (scaled(model)) {
        map_weight(theta[next], 2, next, out);
        return true;
    }
    const bool state = model.hold == kHoldState;
    out.natural.variance[0] = state ? model.held : math::exp(theta[next]);
    out.natural.white = state ? math::exp(theta[next]) : model.held;
    out.chain[state ? 3 : 2][next] = 1;
    return true;
}

template <class R>
bool map(const Model<R>& model, const R* theta, Mapped<R>& out) {
    out = Mapped<R>();
    Natural<R>& natural = out.natural;
    switch (model.family) {
        case kWhite:
            natural.white = 1;
            return true;
        case kFractional:
            return map_fractional(model, theta, out);
        case kAr2: {  // theta[0] and theta[1] stand for the partial autocorrelations k1 and k2
            R k1, k2, slope1, slope2;
            map_pole(theta[0], k1, slope1);
            map_pole(theta[1], k2, slope2);
            natural.shape[0] = k1 * (1 - k2);
            natural.shape[1] = k2;
            out.chain[0][0] = slope1 * (1 - k2);
            out.chain[0][1] = -k1 * slope2;
            out.chain[1][1] = slope2;
            map_weight(theta[2], 2, 2, out);
            return true;
        }
        case kArfima: {
            const Share<R> share(theta[0]);
            const R range = R(kMostDifference - kLeastDifference);
            natural.shape[0] = R(kLeastDifference) + range * share.value;
            out.chain[0][0] = range * share.slope;
            map_pole(theta[1], natural.shape[1], out.chain[1][1]);
            map_weight(theta[2], 2, 2, out);
            return true;
        }
        case kRising: {
            const Share<R> share(theta[0]);
            natural.shape[0] = share.value;
            out.chain[0][0] = share.slope;
            map_weight(theta[1], 1, 1, out);
            return true;
        }
        default: {
            int first = 0;
            if (low_pass(model.family)) {
                const Share<R> share(theta[1]);
                natural.shape[0] = theta[0];
                natural.shape[1] = 1 + R(kMostPolesOfFilter - 1) * share.value;
                out.chain[0][0] = 1;
                out.chain[1][1] = R(kMostPolesOfFilter - 1) * share.slope;
                first = 2;
            }
            const int count = shapes(model.family);
            for (int k = first; k < count; ++k) map_pole(theta[k], natural.shape[k], out.chain[k][k]);
            map_shares(theta, count, parts(model.family), out);
            return true;
        }
    }
    return false;
}

// Makes any free parameters valid: reflects the order at 0 and 2 into that range, and limits all parameters
// to their bounds.
template <class R>
void canonical(const Model<R>& model, R* theta) {
    R low[Room<R>::kFree], high[Room<R>::kFree];
    bounds(model, low, high);
    if (order_first(model)) {
        const R turned = math::fmod(theta[0] + 2, R(4));
        theta[0] = math::fabs((turned < 0 ? turned + 4 : turned) - 2);
    }
    for (int i = 0; i < free_of(model); ++i) theta[i] = math::fmin(math::fmax(theta[i], low[i]), high[i]);
}

}  // namespace whittle
}  // namespace fltea

#endif
