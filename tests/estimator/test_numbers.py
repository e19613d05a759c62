"""Tests in which the numpy reference and the engine are compared with independent numbers, computed by hand
and in 50 digits (tools/make_golden.py).
"""

from fractions import Fraction as F
from pathlib import Path

import numpy as np
import pytest
from fltea.estimator.engine import instruction_sets
from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reference.filters import Fltea, OrderSettings, ParameterSettings, StateSettings, System
from fltea.records.arrays import Array

from tests.rig.engine_cases import EXAMPLE, columns, reference_run, run, with_


def near(*values: F | int) -> object:
    return pytest.approx([float(value) for value in values], rel=1e-13)


def two_step_filters() -> Fltea:
    """Return the three filters of the calculation by hand, before their first step."""
    # By hand: the system has the sampling period h = 1/4, A(w) = [w 4; 0 -4], B = (1, 0)' and C = [1 0]. Let
    # x1_k be the first element of the state x at step k, and r the first row of A x + B u. The output that a
    # filter predicts for the order a and the parameter w is
    #   Y = h^a r - c_1 x1_{k-1} - c_2 x1_{k-2} - ...,
    # with the weights of the past states c_1 = -a and c_2 = a(a-1)/2. Each filter computes
    #   P̃: predicted variance of what it estimates, the old P + Q,
    #   sigma points: the old estimate with weight 2/3, and those sqrt(3 P̃) above and below it, with 1/6 each,
    #   ỹ: predicted output, the weighted mean of Y at the sigma points,
    #   Pyy: variance of the output, the weighted sum of (Y - ỹ)², plus R = 1/16; in this sum the weight of
    #     the old estimate is 2/3 + 2 = 8/3,
    #   Pαy, Pwy: covariance of estimate and output, the weighted sum of (sigma point - old estimate)(Y - ỹ),
    #   K = Pαy / Pyy or Pwy / Pyy: gain; e = y - ỹ: innovation; K e: correction of the estimate,
    #   P = P̃ - K² Pyy: new variance,
    #   Q = (1 - δ) Q + δ (K e)²: new variance of the random walk; the setting δ is 1/4 for α and 1/5 for w.
    return Fltea(
        System(
            A=lambda w: np.array([[w[0], 4], [0, -4]]),
            B=np.array([[1.0], [0]]),
            C=np.array([[1.0, 0]]),
            h=0.25,
        ),
        OrderSettings(P0=1 / 16, Q0=1 / 48, alpha0=0.5, R=1 / 16, delta=1 / 4),
        ParameterSettings(P0=13 / 48, Q0=1 / 16, w0=-4, R=1 / 16, delta=1 / 5),
        StateSettings(P0=[[1, 0], [0, 2]], Q=[[1 / 2, 0], [0, 1]], x0=[2, 1], R=2),
        window=10,
    )


def test_all_three_filters_for_two_steps() -> None:
    fltea = two_step_filters()
    check_first_step(fltea)
    check_second_step(fltea)


def check_first_step(fltea: Fltea) -> None:
    # By hand, step k = 1 with the input u_0 = 6 and the measurement y_1 = 19/4. `two_step_filters` has the
    # system and the meaning of the symbols. With x = (2, 1) and w = -4, the first row of A x + B u is r = -8
    # + 4 + 6 = 2.
    step = fltea.step(19 / 4, 6)
    # KFo (filter of the order), with x1_0 = 2, the first element of the first state:
    #   Predicted variance P̃ = old P + old Q = 1/16 + 1/48 = 1/12.
    #   Sigma points a = 1/2 and 1/2 ± sqrt(3 P̃): 1/2, 1, 0, with the weights 2/3, 1/6, 1/6.
    #   Predicted output Y = 2 h^a + 2a: 2 at a = 1/2, 5/2 at a = 1, 2 at a = 0.
    #   Mean of Y: ỹ = 2/3 * 2 + (5/2 + 2)/6 = 25/12. Deviations Y - ỹ: -1/12, 5/12, -1/12.
    #   Variance of the output Pyy = 8/3 * 1/144 + (25 + 1)/(6 * 144) + 1/16 = 1/9,
    #     where the weight at a = 1/2 is 2/3 + 2 = 8/3.
    #   Covariance of order and output Pαy = (1/2 * 5/12 + 1/2 * 1/12)/6 = 1/24.
    #   Gain K = 3/8. Innovation e = 57/12 - 25/12 = 8/3. Correction K e = 1, so the new order is 3/2.
    #   New variance P = 1/12 - 9/64 * 1/9 = 13/192.
    #   New Q = 3/4 * 1/48 + 1/4 * 1 = 17/64.
    assert (step.order, step.order_variance) == near(F(3, 2), F(13, 192))
    assert fltea.order.Q[0, 0] == pytest.approx(17 / 64, rel=1e-13)
    # KFw (filter of the parameter) at the new order 3/2, with h^α = 1/8 and c_1 = -3/2:
    #   Predicted variance P̃ = old P + old Q = 13/48 + 1/16 = 1/3.
    #   Sigma points w = -4, -3, -5 (sqrt(3 P̃) = 1), with the weights 2/3, 1/6, 1/6.
    #   Predicted output Y = (2w + 10)/8 + 3: 13/4 at w = -4, 7/2 at w = -3, 3 at w = -5.
    #   Mean of Y: ỹ = 13/4. Deviations Y - ỹ: 0, 1/4, -1/4.
    #   Variance of the output Pyy = 2/6 * 1/16 + 1/16 = 1/12.
    #   Covariance of parameter and output Pwy = (1/4 + 1/4)/6 = 1/12.
    #   Gain K = 1. Innovation e = 19/4 - 13/4 = 3/2. Correction K e = 3/2, so the new w is -5/2.
    #   New variance P = 1/3 - 1/12 = 1/4.
    #   New Q = 4/5 * 1/16 + 1/5 * 9/4 = 1/2.
    assert (step.w[0], step.Pw[0, 0]) == near(F(-5, 2), F(1, 4))
    assert fltea.parameter.Q[0, 0] == pytest.approx(1 / 2, rel=1e-13)
    # KFx (filter of the state) at the new order 3/2, with R = 2 and the old parameter w = -4:
    #   A = [w 4; 0 -4] = [-4 4; 0 -4], h^α = 1/8 and c_1 = -3/2.
    #   Transition F = h^α A - c_1 = A/8 + 3/2 = [1 1/2; 0 1].
    #   Predicted state x̃ = (2, -4)/8 + 3/2 (2, 1) = (13/4, 1).
    #   Its covariance P̃ = F diag(1, 2) F' + Q = [3/2+1/2 1; 1 2+1] = [2 1; 1 3].
    #   Innovation e = 19/4 - 13/4 = 3/2, its variance S = 2 + R = 4. Gain K = (2, 1)/4 = (1/2, 1/4).
    #   New state x̂ = x̃ + K e = (4, 11/8), its covariance P = P̃ - K S K' = [1 1/2; 1/2 11/4].
    assert step.x == near(4, F(11, 8))
    assert step.P.ravel() == near(1, F(1, 2), F(1, 2), F(11, 4))
    assert (step.innovation[0], step.innovation_variance[0, 0]) == near(F(3, 2), 4)


def check_second_step(fltea: Fltea) -> None:
    # By hand, step k = 2 with the input u_1 = 209/18 and the measurement y_2 = 755/144. The old values are
    # the results of step 1: the state x̂ = (4, 11/8) and the parameter w = -5/2. So the rows of A x̂ + B u
    # are r = 4w + 4 * 11/8 + u_1 = -10 + 11/2 + 209/18 = 64/9, and -4 * 11/8 = -11/2.
    step = fltea.step(755 / 144, 209 / 18)
    # KFo (filter of the order), with h = 1/4 and the first elements of the states, x1_1 = 4 and x1_0 = 2:
    #   Predicted variance P̃ = old P + old Q = 13/192 + 17/64 = 1/3.
    #   Sigma points a = 3/2, 5/2, 1/2 (sqrt(3 P̃) = 1), with the weights 2/3, 1/6, 1/6.
    #   Predicted output Y = r h^a + 4a - a(a-1), where r = 64/9, at the sigma points a:
    #     at a = 3/2: 8/9 + 21/4 = 221/36; at a = 5/2: 2/9 + 25/4 = 233/36; at a = 1/2: 32/9 + 9/4 = 209/36.
    #   Mean of Y: ỹ = 2/3 * 221/36 + (233 + 209)/(6 * 36) = 221/36. Deviations Y - ỹ: 0, 1/3, -1/3.
    #   Variance of the output Pyy = 2/(6 * 9) + R = 1/27 + 1/16 = 43/432.
    #   Covariance of order and output Pαy = (1/3 + 1/3)/6 = 1/9. Gain K = Pαy / Pyy = 48/43.
    #   Innovation e = y_2 - ỹ = 755/144 - 884/144 = -43/48. Correction K e = -1, so the new order is 1/2.
    #   New variance P = 1/3 - K Pαy = 1/3 - 48/43 * 1/9 = 9/43.
    #   New Q = 3/4 * 17/64 + 1/4 * 1 = 115/256.
    assert (step.order, step.order_variance) == near(F(1, 2), F(9, 43))
    assert fltea.order.Q[0, 0] == pytest.approx(115 / 256, rel=1e-13)
    # KFw (filter of the parameter) at order 1/2, with h^α = 1/2, c_1 = -1/2 and c_2 = -1/8:
    #   Predicted variance P̃ = old P + old Q = 1/4 + 1/2 = 3/4.
    #   Sigma points w = -5/2, -1, -4 (sqrt(3 P̃) = 3/2), with the weights 2/3, 1/6, 1/6.
    #   Predicted output Y = (4w + 11/2 + 209/18)/2 + 2 + 1/4, which is linear in w with the slope 2.
    #   Mean of Y: ỹ = Y at w = -5/2 = 32/9 + 9/4 = 209/36.
    #   Variance of the output Pyy = 2² P̃ + 1/16 = 4 * 3/4 + 1/16 = 49/16.
    #   Covariance of parameter and output Pwy = 2 P̃ = 3/2.
    #   Gain K = 24/49. Innovation e = 755/144 - 836/144 = -9/16.
    #   Correction K e = -27/98, so the new w is -136/49.
    #   New variance P = 3/4 - (24/49)² 49/16 = 3/196.
    #   New Q = 4/5 * 1/2 + 1/5 * 729/9604 = 19937/48020.
    assert (step.w[0], step.Pw[0, 0]) == near(F(-136, 49), F(3, 196))
    assert fltea.parameter.Q[0, 0] == pytest.approx(19937 / 48020, rel=1e-13)
    # KFx (filter of the state) at the new order 1/2, with R = 2 and the old parameter w = -5/2:
    #   A = [w 4; 0 -4] = [-5/2 4; 0 -4], h^α = 1/2, c_1 = -1/2 and c_2 = -1/8.
    #   Transition F = h^α A - c_1 = A/2 + 1/2 = [-3/4 2; 0 -3/2].
    #   Predicted state x̃ = (64/9, -11/2)/2 + (4, 11/8)/2 + (2, 1)/8 = (209/36, -31/16).
    #   Its covariance P̃ = F P_1 F' + c_2² P_0 + Q = [677/64 -123/16; -123/16 231/32],
    #     with F P_1 F' = [161 -123; -123 99]/16 and c_2² P_0 = diag(1, 2)/64.
    #   Innovation e = -9/16, its variance S = 677/64 + R = 805/64. Gain K = (677, -492)/805.
    #   New covariance P = P̃ - K S K'. Its elements are 677/64 * 2/S, -123/16 * 2/S (twice), and
    #     231/32 - 492²/(805 * 64) = 64923/25760.
    assert step.innovation_variance[0, 0] == pytest.approx(805 / 64, rel=1e-13)
    assert step.x == near(F(209, 36) - F(677 * 9, 805 * 16), -F(31, 16) + F(492 * 9, 805 * 16))
    assert step.P.ravel() == near(F(1354, 805), -F(984, 805), -F(984, 805), F(64923, 25760))


ROOT = Path(__file__).resolve().parents[2]
# Columns of the golden files for the quantities in engine_cases.ESTIMATES, in that order. The variances Q of
# the random walks are left out.
COLUMNS = [4, 5, 7, 8, 2, 3]


def golden(number: int) -> tuple[Array, Array, Array]:
    """Return measurements, inputs and expected estimates of an example, the latter as an array (200, 6)."""
    table = np.loadtxt(ROOT / f"tests/estimator/golden/example_{number}.txt")
    return table[:, 0], table[:, 1], table[:, COLUMNS]


@pytest.mark.parametrize("number", [1, 2, 3])
def test_reference_equals_the_formulas(number: int) -> None:
    y, u, expected = golden(number)
    got = reference_run(EXAMPLE, y, u, np.zeros(len(y), dtype=bool))[:, :6]
    np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-13)


COMPRESSED = with_(EXAMPLE, memory="compressed", accuracy=9)


@pytest.mark.parametrize("instruction_set", instruction_sets())
@pytest.mark.parametrize(("tuning", "rtol", "atol"), [(EXAMPLE, 1e-10, 1e-13), (COMPRESSED, 1e-4, 1e-5)])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_engine_equals_the_formulas(
    number: int, tuning: LaneSettings, rtol: float, atol: float, instruction_set: str
) -> None:
    y, u, expected = golden(number)
    estimates = run(tuning, y[:, np.newaxis], u[:, np.newaxis], instruction_set=instruction_set)
    np.testing.assert_allclose(columns(estimates)[:, :6], expected, rtol=rtol, atol=atol)
