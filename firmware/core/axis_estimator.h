// One axis of the gyroscope: start-up window, filter, supervisor. The filter is the host's (engine/lane.hpp)
// in float, over a memory in integers.
#pragma once

#include <new>

#include "baseline.h"
#include "engine/lane.hpp"
#include "engine/memory_fixed.hpp"
#include "messages.h"
#include "mpu9250.h"
#include "settings.h"
#include "supervisor.h"

namespace fltea {

class AxisEstimator {
  public:
    // Forgets everything: a new start-up window.
    void begin() {
        baseline_ = Baseline();
        restarts_ = 0;
        lane_ = nullptr;
        begin_watch();
    }

    // One sample of the start-up window.
    void collect(int16_t count) { baseline_.add(count); }

    // The window is full.
    void start() {
        if (baseline_.constant()) return;
        const float R = r();
        lane_ = new (storage_)
            Lane(engine::FixedMemory(R), tuning(R), static_cast<engine::Guard>(settings::kGuard));
    }

    // One sample after the window, or none (a lost one): a prediction.
    void step(const int16_t* count) {
        if (lane_ == nullptr) return;
        engine::Sample<float> sample = {0.0f, 0.0f, count == nullptr};
        if (count != nullptr) sample.y = baseline_.centred(*count) / kLsb;
        lane_->step(sample, estimate_);
        const float held = lane_->state().counts[engine::kStateBound];
        const Supervisor::Verdict verdict =
            supervisor_.judge(estimate_.alpha, estimate_.f, estimate_.x, held > held_);
        held_ = held;
        missing_ = count == nullptr;
        if (!verdict.restart) {
            valid_ = verdict.valid;
            return;
        }
        lane_->reset(true);
        begin_watch();
        ++restarts_;
    }

    // Fills in all but axis, sample and age.
    void report(Estimate& message) const {
        message.flags = 0;
        if (lane_ == nullptr) {
            message.flags |= estimate_flags::constant;
            return;
        }
        if (valid_) message.flags |= estimate_flags::valid;
        if (missing_) message.flags |= estimate_flags::missing;
        if (valid_) {
            message.alpha = estimate_.alpha;
            message.alpha_std = root(estimate_.alpha_variance);
            message.f = estimate_.f;
            message.f_std = root(estimate_.f_variance);
            message.state = estimate_.x;
            if (!missing_) message.innovation = estimate_.innovation;
        }
        const float* const counts = lane_->state().counts;
        uint32_t* const to[] = {
            &message.order_box,      &message.order_sigma,   &message.order_variance,
            &message.order_gate,     &message.parameter_box, &message.parameter_variance,
            &message.parameter_gate, &message.state_bound,   &message.memory_order,
        };
        static_assert(sizeof to / sizeof *to == engine::kCauses, "one field here is one cause there");
        for (int i = 0; i < engine::kCauses; ++i) *to[i] = static_cast<uint32_t>(counts[i]);
    }

    // Of the window; 0 while it fills. r() of an axis that never changed is 0 too.
    float bias_dps() const { return started() ? baseline_.bias() / kLsb : 0.0f; }
    float r_dps2() const { return lane_ != nullptr ? r() : 0.0f; }
    uint16_t restarts() const { return restarts_; }

    static engine::Tuning<float> tuning(float R) {
        namespace s = settings;
        constexpr bool joint = s::kVariant == EstimatorVariant::joint;
        engine::Tuning<float> t = {};
        t.log_h = static_cast<float>(__builtin_log(1e-6 * s::kSamplePeriodUs));
        t.x0 = s::kStateX0, t.P0 = s::kStateP0, t.Q = s::kStateQ, t.R = R;
        t.alpha0 = joint ? s::kJointAlpha0 : s::kOrderAlpha0;
        t.order_P0 = joint ? s::kJointP0 : s::kOrderP0;
        t.order_Q0 = joint ? s::kJointQ0 : s::kOrderQ0;
        t.order_delta = joint ? s::kJointDelta : s::kOrderDelta;
        t.f0 = joint ? s::kJointBeta0 : s::kParameterF0;
        t.parameter_P0 = joint ? s::kJointP0 : s::kParameterP0;
        t.parameter_Q0 = joint ? s::kJointQ0 : s::kParameterQ0;
        t.parameter_delta = joint ? s::kJointDelta : s::kParameterDelta;
        t.order_R = t.parameter_R = joint ? s::kStateQ + R : R;
        t.gate = s::kGate;
        return t;
    }

  private:
    static_assert(settings::kGuard != EstimatorGuard::off,
                  "FixedMemory serves the orders of the guard's box only");

    template <EstimatorVariant V, class Unused = void>
    struct VariantOf {
        typedef engine::Joint<float> Type;
    };
    template <class Unused>
    struct VariantOf<EstimatorVariant::triple, Unused> {
        typedef engine::Triple<float> Type;
    };
    typedef engine::Lane<float, VariantOf<settings::kVariant>::Type, engine::FixedMemory> Lane;

    static constexpr float kLsb = static_cast<float>(kGyroLsbTenths) / 10.0f;  // counts per deg/s

    void begin_watch() {
        supervisor_ = Supervisor();
        held_ = 0;
        valid_ = false;
    }

    bool started() const { return baseline_.samples() >= settings::kStartup; }
    float r() const { return baseline_.variance() / (kLsb * kLsb); }
    static float root(float variance) { return variance > 0 ? engine::sqrt(variance) : 0.0f; }

    Baseline baseline_;
    Supervisor supervisor_;
    engine::Estimate<float> estimate_ = {};
    float held_ = 0;  // steps in which the guard held the state
    uint16_t restarts_ = 0;
    bool valid_ = false;
    bool missing_ = false;
    Lane* lane_ = nullptr;
    alignas(Lane) unsigned char storage_[sizeof(Lane)];
};

}  // namespace fltea
