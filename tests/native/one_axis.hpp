// A sensor of one axis, for the tests of the tracker.
#pragma once

#include <vector>

#include "sensor_tracker.hpp"

namespace fltea {
namespace track {

class OneAxis {
  public:
    explicit OneAxis(const double* offset = nullptr, const TrackerRules& rules = TrackerRules())
        : sensor_(rules, 1.0) {
        sensor_.add_axis(offset);
    }
    Tracked next(double y) {
        Tracked found = Tracked();
        sensor_.next(&y, nullptr, 0, kUnknown, 0, &found, events);
        return found;
    }
    void skip(std::uint64_t count) { sensor_.skip(count); }
    bool set(const System<kMost>& system) { return axis().set({system}, {1.0}, false); }
    AxisTracker& axis() { return sensor_.axes().front(); }
    template <typename Io>
    void visit(Io& io) {
        sensor_.visit(io);
    }

    std::vector<TrackerEvent> events;

  private:
    SensorTracker sensor_;
};

}  // namespace track
}  // namespace fltea
