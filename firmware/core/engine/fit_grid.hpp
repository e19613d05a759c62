// Starting points for a fit on the device if there is no previous result to start from. They form a grid of
// values of the models' free parameters (whittle_models.hpp).
#ifndef FLTEA_FIT_GRID_HPP
#define FLTEA_FIT_GRID_HPP

#include "real_math.hpp"

namespace fltea {
namespace whittle {
inline namespace FLTEA_INSTRUCTION_SET {

class FitGrid {
    enum { kPoles = 8, kWeights = 3, kOrders = 6, kOrdersUpToOne = 4, kShares = 6 };

  public:
    // The points of the grid with orders up to 1 come first.
    enum {
        kOfRelaxation = kPoles * kWeights,
        kOfOrdersUpToOne = kOrdersUpToOne * kShares * kWeights,
        kOfOrdersAbove = (kOrders - kOrdersUpToOne) * kShares * kWeights,
    };

    static void relaxation(int place, float* theta) {
        // logits of the poles of the relaxation (first-order Gauss-Markov process)
        static const float poles[kPoles] = {-2.2f, -0.5f, 0.5f, 1.4f, 2.6f, 3.7f, 5.0f, 7.6f};
        theta[0] = poles[place / kWeights];
        theta[1] = weight(place);
        theta[2] = 0;
    }
    static void order(int place, float* theta) {
        static const float orders[kOrders] = {0.15f, 0.45f, 0.75f, 1.0f, 1.3f, 1.75f};
        static const float shares[kShares] = {-7.0f, -4.6f, -2.4f, -0.6f, 1.4f, 3.0f};
        theta[0] = orders[place / (kShares * kWeights)];
        theta[1] = shares[place / kWeights % kShares];
        theta[2] = weight(place);
    }

  private:
    static float weight(int place) {
        static const float weights[kWeights] = {-6.9f, -2.9f, -0.4f};
        return weights[place % kWeights];
    }
};

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace whittle
}  // namespace fltea

#endif
