// The limits of the null test. The test rejects white noise if its likelihood ratio exceeds a quantile of
// that ratio for pure white noise. Each quantile is a quadratic polynomial in the decimal logarithm of the
// number of ordinates. The coefficients are those of host/fltea/spectrum/null_constants.py, for the three
// levels of significance that the device needs.
#ifndef FLTEA_NULL_QUANTILES_HPP
#define FLTEA_NULL_QUANTILES_HPP

#include "real_math.hpp"

namespace fltea {
namespace whittle {

enum NullLevel : int { kFivePercent, kOnePercent, kOneInThousand, kNullLevels };

// Returns the likelihood ratio that white noise exceeds with the probability `level`, for a periodogram with
// this number of ordinates.
inline float null_quantile(NullLevel level, float ordinates) {
    static const float coefficients[kNullLevels][3] = {
        {3.7125f, 1.0516f, -0.0805f},
        {7.9484f, 0.4336f, 0.0000f},
        {11.6669f, 0.6161f, 0.0000f},
    };
    const float x = math::log(ordinates) * 0.4342944819f;
    const float* const c = coefficients[level];
    return c[0] + x * (c[1] + x * c[2]);
}

}  // namespace whittle
}  // namespace fltea

#endif
