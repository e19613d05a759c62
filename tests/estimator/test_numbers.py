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
    # By hand: the system is h = 1/4, A(w) = [w 4; 0 -4], B = (1, 0)', C = [1 0]. Let r be the first row of A
    # x + B u. The predicted output at the order a is Y(a) = h^a r - c_1(a) x1_{k-1} - c_2(a) x1_{k-2} - ...,
    # with the weights of the past c_1 = -a and c_2 = a(a-1)/2.
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
    # By hand, step k = 1 with the input u_0 = 6 and the measurement y_1 = 19/4: r = -8 + 4 + 6 = 2.
    step = fltea.step(19 / 4, 6)
    # KFo (filter of the order): predicted variance P̃o = 1/16 + 1/48 = 1/12.
    #   Sigma points 1/2 and 1/2 ± sqrt(3/12): 1/2, 1, 0.
    #   Y = 2 h^a + 2a = 2, 5/2, 2; ỹ = 4/3 + (5/2 + 2)/6 = 25/12; deviations -1/12, 5/12, -1/12.
    #   Pyy = 8/3 * 1/144 + (25 + 1)/(6 * 144) + 1/16 = 1/9; Pαy = (1/2 * 5/12 + 1/2 * 1/12)/6 = 1/24;
    #   K = 3/8; e = 57/12 - 25/12 = 8/3, correction 1; P = 1/12 - 9/64 * 1/9 = 13/192;
    #   Q = 3/4 * 1/48 + 1/4 * 1 = 17/64.
    assert (step.order, step.order_variance) == near(F(3, 2), F(13, 192))
    assert fltea.order.Q[0, 0] == pytest.approx(17 / 64, rel=1e-13)
    # KFw (filter of the parameter) at the new order 3/2: h^α = 1/8, c_1 = -3/2.
    #   Predicted variance P̃w = 13/48 + 1/16 = 1/3, sigma points -4, -3, -5.
    #   Y = (2w + 10)/8 + 3 = 13/4, 7/2, 3; ỹ = 13/4; Pyy = 2/6 * 1/16 + 1/16 = 1/12;
    #   Pwy = (1/4 + 1/4)/6 = 1/12; K = 1; e = 3/2; w = -5/2; P = 1/3 - 1/12 = 1/4;
    #   Q = 4/5 * 1/16 + 1/5 * 9/4 = 1/2.
    assert (step.w[0], step.Pw[0, 0]) == near(F(-5, 2), F(1, 4))
    assert fltea.parameter.Q[0, 0] == pytest.approx(1 / 2, rel=1e-13)
    # KFx (filter of the state) at order 3/2 and the old w = -4: F = A/8 + 3/2 = [1 1/2; 0 1].
    #   x̃ = (2, -4)/8 + 3/2 (2, 1) = (13/4, 1); P̃ = F diag(1, 2) F' + Q = [3/2+1/2 1; 1 2+1] = [2 1; 1 3].
    #   S = 4, K = (1/2, 1/4), e = 3/2: x̂ = (4, 11/8); P = P̃ - K S K' = [1 1/2; 1/2 11/4].
    assert step.x == near(4, F(11, 8))
    assert step.P.ravel() == near(1, F(1, 2), F(1, 2), F(11, 4))
    assert (step.innovation[0], step.innovation_variance[0, 0]) == near(F(3, 2), 4)

    # By hand, step k = 2 with the input u_1 = 209/18 and the measurement y_2 = 755/144. The rows of A x̂ + B
    # u with w = -5/2 are r = -10 + 11/2 + 209/18 = 64/9, and -11/2.
    step = fltea.step(755 / 144, 209 / 18)
    # KFo (filter of the order): predicted variance P̃o = 13/192 + 17/64 = 1/3, sigma points 3/2, 5/2, 1/2.
    #   Y = 64/9 h^a + 4a - a(a-1): 8/9 + 21/4 = 221/36; 2/9 + 25/4 = 233/36; 32/9 + 9/4 = 209/36;
    #   ỹ = 2/3 * 221/36 + 442/(6 * 36) = 221/36; deviations 0, 1/3, -1/3.
    #   Pyy = 2/(6 * 9) + 1/16 = 43/432; Pαy = (1/3 + 1/3)/6 = 1/9; K = 48/43; e = 755/144 - 884/144 = -43/48;
    #   correction -1; P = 1/3 - 48/43 * 1/9 = 9/43; Q = 3/4 * 17/64 + 1/4 = 115/256.
    assert (step.order, step.order_variance) == near(F(1, 2), F(9, 43))
    assert fltea.order.Q[0, 0] == pytest.approx(115 / 256, rel=1e-13)
    # KFw (filter of the parameter) at order 1/2: h^α = 1/2, c_1 = -1/2, c_2 = -1/8.
    #   Predicted variance P̃w = 1/4 + 1/2 = 3/4, sigma points -5/2, -1, -4.
    #   Y = (4w + 11/2 + 209/18)/2 + 2 + 1/4: slope 2, ỹ = 32/9 + 9/4 = 209/36; Pyy = 4 * 3/4 + 1/16 = 49/16;
    #   Pwy = 3/2; K = 24/49; e = 755/144 - 836/144 = -9/16; correction -27/98; w = -136/49;
    #   P = 3/4 - (24/49)² 49/16 = 3/196; Q = 4/5 * 1/2 + 1/5 * 729/9604 = 19937/48020.
    assert (step.w[0], step.Pw[0, 0]) == near(F(-136, 49), F(3, 196))
    assert fltea.parameter.Q[0, 0] == pytest.approx(19937 / 48020, rel=1e-13)
    # KFx (filter of the state) at order 1/2 and w = -5/2: F = A/2 + 1/2 = [-3/4 2; 0 -3/2].
    #   x̃ = (64/9, -11/2)/2 + (4, 11/8)/2 + (2, 1)/8 = (209/36, -31/16).
    #   F P_1 F' = [161 -123; -123 99]/16; c_2² P_0 = diag(1, 2)/64; P̃ = [677/64 -123/16; -123/16 231/32].
    #   S = 677/64 + 2 = 805/64; K = (677, -492)/805; e = -9/16.
    #   P = P̃ - K S K': 677/64 * 2/S, -123/16 * 2/S, 231/32 - 492²/(805 * 64) = 64923/25760.
    assert step.innovation_variance[0, 0] == pytest.approx(805 / 64, rel=1e-13)
    assert step.x == near(F(209, 36) - F(677 * 9, 805 * 16), -F(31, 16) + F(492 * 9, 805 * 16))
    assert step.P.ravel() == near(F(1354, 805), -F(984, 805), -F(984, 805), F(64923, 25760))


ROOT = Path(__file__).resolve().parents[2]
# Columns of the golden files with the quantities of engine_cases.ESTIMATES, in that order, without Q of the
# random walks.
COLUMNS = [4, 5, 7, 8, 2, 3]


def golden(number: int) -> tuple[Array, Array, Array]:
    """Return y, u and the expected estimates of an example, the latter as an array (200, 6)."""
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
