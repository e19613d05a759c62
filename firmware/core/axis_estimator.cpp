#include "axis_estimator.h"

#include <new>

#include "engine/lane.hpp"
#include "engine/memory_fixed.hpp"
#include "mpu9250.h"

namespace fltea {

namespace {

static_assert(settings::kGuard != EstimatorGuard::off,
              "FixedMemory serves the orders of the guard's box only");

// sensitivity of the gyroscope [counts per deg/s]
constexpr float kLsb = static_cast<float>(kGyroLsbTenths) / 10.0f;
constexpr bool kJoint = settings::kVariant == EstimatorVariant::joint;

template <bool>
struct VariantOf {
    typedef engine::Triple<float> Type;
};
template <>
struct VariantOf<true> {
    typedef engine::Joint<float> Type;
};
typedef engine::Lane<float, VariantOf<kJoint>::Type, engine::FixedMemory> Lane;

engine::Tuning<float> tuning(float Q, float R) {
    namespace s = settings;
    engine::Tuning<float> t = {};
    t.log_h = static_cast<float>(__builtin_log(1e-6 * s::kSamplePeriodUs));
    t.x0 = s::kStateX0, t.P0 = s::kStateP0, t.Q = Q, t.R = R;
    t.alpha0 = kJoint ? s::kJointAlpha0 : s::kOrderAlpha0;
    t.order_P0 = kJoint ? s::kJointP0 : s::kOrderP0;
    t.order_Q0 = kJoint ? s::kJointQ0 : s::kOrderQ0;
    t.order_delta = kJoint ? s::kJointDelta : s::kOrderDelta;
    t.f0 = kJoint ? s::kJointBeta0 : s::kParameterF0;
    t.parameter_P0 = kJoint ? s::kJointP0 : s::kParameterP0;
    t.parameter_Q0 = kJoint ? s::kJointQ0 : s::kParameterQ0;
    t.parameter_delta = kJoint ? s::kJointDelta : s::kParameterDelta;
    t.order_R = t.parameter_R = kJoint ? Q + R : R;
    t.gate = s::kGate;
    return t;
}

float root(float variance) { return variance > 0 ? engine::sqrt(variance) : 0.0f; }

}  // namespace

struct AxisEstimator::Filter {
    explicit Filter(float R)
        : r_dps2(R),
          lane(engine::FixedMemory(R), tuning(settings::kStateQ, R),
               static_cast<engine::Guard>(settings::kGuard)) {}

    float r_dps2;
    Lane lane;
    engine::Estimate<float> estimate = {};
    // How often the guard (engine/guard.hpp) has limited a value of the filters, for each cause. The counts
    // are integers: a float would stop counting at 2^24.
    uint32_t interventions[engine::kCauses] = {};
};

void AxisEstimator::begin() {
    baseline_ = engine::Baseline<int16_t>();
    filter_ = nullptr;
    restarts_ = 0;
    tuned_ = false;
    begin_watch();
}

void AxisEstimator::begin_watch() {
    supervisor_ = engine::Supervisor<float>();
    valid_ = false;
}

void AxisEstimator::start() {
    static_assert(sizeof(Filter) <= kFilterBytes && alignof(Filter) <= 8, "the filter fits its storage");
    if (!baseline_.constant()) filter_ = new (storage_) Filter(baseline_.variance() / (kLsb * kLsb));
}

void AxisEstimator::retune(float Q_dps2, float R_dps2) {
    if (filter_ == nullptr || !(Q_dps2 > 0) || !(R_dps2 > 0)) return;
    filter_->lane.retune(tuning(Q_dps2, R_dps2));
    filter_->r_dps2 = R_dps2;
    tuned_ = true;
}

void AxisEstimator::step(const int16_t* count) {
    if (filter_ == nullptr) return;
    engine::Sample<float> sample = {0.0f, 0.0f, count == nullptr};
    if (count != nullptr) sample.y = baseline_.centred(*count) / kLsb;
    engine::Estimate<float>& estimate = filter_->estimate;
    filter_->lane.step(sample, estimate);
    float* const acted = filter_->lane.state().counts;
    const bool held = acted[engine::kStateBound] != 0;
    for (int i = 0; i < engine::kCauses; ++i) {
        filter_->interventions[i] += acted[i] != 0 ? 1 : 0;
        acted[i] = 0;
    }
    const engine::Supervisor<float>::Verdict verdict =
        supervisor_.judge(estimate.alpha, estimate.f, estimate.x, held);
    missing_ = count == nullptr;
    valid_ = verdict.valid;
    if (!verdict.restart) return;
    filter_->lane.reset(true);
    for (uint32_t& count : filter_->interventions) count = 0;
    begin_watch();
    ++restarts_;
}

void AxisEstimator::report(Estimate& message) const {
    if (filter_ == nullptr) {
        message.flags |= estimate_flags::constant;
        return;
    }
    if (missing_) message.flags |= estimate_flags::missing;
    if (tuned_) message.flags |= estimate_flags::tuned;
    if (valid_) {
        const engine::Estimate<float>& estimate = filter_->estimate;
        message.flags |= estimate_flags::valid;
        message.alpha = estimate.alpha;
        message.alpha_std = root(estimate.alpha_variance);
        message.f = estimate.f;
        message.f_std = root(estimate.f_variance);
        message.state = estimate.x;
        if (!missing_) message.innovation = estimate.innovation;
    }
    uint32_t* const to[] = {
        &message.order_box,      &message.order_sigma,   &message.order_variance,
        &message.order_gate,     &message.parameter_box, &message.parameter_variance,
        &message.parameter_gate, &message.state_bound,   &message.memory_order,
    };
    static_assert(sizeof to / sizeof *to == engine::kCauses, "one field here is one cause there");
    for (int i = 0; i < engine::kCauses; ++i) *to[i] = filter_->interventions[i];
}

float AxisEstimator::bias_dps() const {
    return baseline_.samples() < settings::kStartup ? 0.0f : baseline_.bias() / kLsb;
}

float AxisEstimator::r_dps2() const { return filter_ == nullptr ? 0.0f : filter_->r_dps2; }

void AxisEstimator::describe(Estimator& message) {
    const engine::Tuning<float> t = tuning(settings::kStateQ, 0.0f);
    message.state_x0 = t.x0;
    message.state_p0 = t.P0;
    message.state_q = t.Q;
    message.alpha0 = t.alpha0;
    message.alpha_p0 = t.order_P0;
    message.alpha_q0 = t.order_Q0;
    message.alpha_delta = t.order_delta;
    message.parameter0 = t.f0;
    message.parameter_p0 = t.parameter_P0;
    message.parameter_q0 = t.parameter_Q0;
    message.parameter_delta = t.parameter_delta;
    message.gate = t.gate;
}

}  // namespace fltea
