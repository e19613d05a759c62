// The device's estimator of one axis behind a C interface, for tests and benchmarks in Python: a shared
// library for each variant. It is one translation unit, so that its dependencies are known.
#include <cstddef>

#include "axis_estimator.cpp"

namespace {

using fltea::AxisEstimator;
using fltea::Estimate;

class Device {
  public:
    Device() { axis.begin(); }

    // Processes one sample, or a lost one, and fills a row; false while the start-up window fills.
    bool take(const int16_t* count, double* row) {
        if (collected_ < fltea::settings::kStartup) {
            if (count == nullptr) return false;
            axis.collect(*count);
            if (++collected_ == fltea::settings::kStartup) axis.start();
            return false;
        }
        axis.step(count);
        Estimate estimate = Estimate();
        axis.report(estimate);
        Row fields = {row};
        Estimate::visit_fields(estimate, fields);
        return true;
    }

    AxisEstimator axis;

  private:
    // Every field of ESTIMATE, in its order.
    struct Row {
        double* next;
        template <class Field>
        void operator()(const char*, const Field& field) {
            *next++ = static_cast<double>(field);
        }
    };

    int collected_ = 0;
};

}  // namespace

extern "C" {
int device_startup() { return fltea::settings::kStartup; }
double device_lsb_per_dps() { return 0.1 * fltea::kGyroLsbTenths; }
Device* device_make() { return new Device(); }
void device_free(Device* device) { delete device; }
// n samples, oldest first; `missing` marks lost ones. Writes rows of 19 numbers for those after the start-up
// window; returns their number.
std::size_t device_run(Device* device, std::size_t n, const int16_t* counts, const unsigned char* missing,
                       double* rows) {
    std::size_t made = 0;
    for (std::size_t k = 0; k < n; ++k) {
        made += device->take(missing[k] ? nullptr : counts + k, rows + 19 * made);
    }
    return made;
}
// Bias, R and restarts.
void device_baseline(const Device* device, double* out) {
    out[0] = static_cast<double>(device->axis.bias_dps());
    out[1] = static_cast<double>(device->axis.r_dps2());
    out[2] = static_cast<double>(device->axis.restarts());
}
}
