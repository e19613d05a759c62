// The device's estimator of one axis behind a C interface, for tests and benchmarks in Python. A shared
// library is built for each variant of the estimator. The code of each is a single source file, so that its
// dependencies are known.
#include <cstddef>

#include "axis_estimator.cpp"

namespace {

using fltea::AxisEstimator;
using fltea::Estimate;

class Device {
  public:
    Device() { axis.begin(); }

    // Processes one sample, or a lost sample if `count` is null. Writes the results to `row` and returns
    // true, or returns false until the start-up window is full.
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
    // Writes every field of an ESTIMATE to a row, in the order of the message.
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
// Processes n samples, oldest first; `missing` marks lost samples. Writes a row for each sample after the
// start-up window, with the 19 fields of an ESTIMATE, and returns the number of rows.
std::size_t device_run(Device* device, std::size_t n, const int16_t* counts, const unsigned char* missing,
                       double* rows) {
    std::size_t made = 0;
    for (std::size_t k = 0; k < n; ++k) {
        made += device->take(missing[k] ? nullptr : counts + k, rows + 19 * made);
    }
    return made;
}
// Writes three numbers: bias and variance R of the white noise, both from the start-up window, and the number
// of restarts of the filters.
void device_baseline(const Device* device, double* out) {
    out[0] = static_cast<double>(device->axis.bias_dps());
    out[1] = static_cast<double>(device->axis.r_dps2());
    out[2] = static_cast<double>(device->axis.restarts());
}
}
