// The tracker of a sensor with a single axis, for the tests of the tracker.
#pragma once

#include <vector>

#include "sensor_tracker.hpp"

namespace fltea {
namespace track {

class OneAxis {
  public:
    explicit OneAxis(const double* offset = nullptr, const TrackerRules& rules = TrackerRules())
        : rules_(rules), sensor_(rules, 1.0) {
        sensor_.add_axis(offset);
    }
    Tracked next(double y) {
        Tracked found = Tracked();
        sensor_.next(&y, nullptr, 0, kUnknown, 0, &found, events);
        return found;
    }
    void skip(std::uint64_t count) { sensor_.skip(count); }
    bool set(const System<kMost>& system) { return set({system}, {1.0}); }
    bool set(const std::vector<System<kMost>>& systems, const std::vector<double>& weights) {
        const std::shared_ptr<TrackerModel> model = made(systems, weights);
        return model != nullptr && axis().set(model);
    }
    std::shared_ptr<TrackerModel> made(const std::vector<System<kMost>>& systems,
                                       const std::vector<double>& weights) const {
        return TrackerModel::made(systems, weights, false, rules_);
    }
    AxisTracker& axis() { return sensor_.axes().front(); }
    template <typename Io>
    void visit(Io& io) {
        sensor_.visit(io);
    }

    std::vector<TrackerEvent> events;

  private:
    TrackerRules rules_;
    SensorTracker sensor_;
};

}  // namespace track
}  // namespace fltea
