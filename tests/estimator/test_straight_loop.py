"""The reference against a second implementation: one state, plain loops, straight from the formulas."""

import math
import random
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest
from fltea.lab.reference.filters import Fltea, OrderSettings, ParameterSettings, StateSettings, System


class Walk(NamedTuple):
    """Settings and state of an order or parameter filter."""

    value: float
    P: float
    Q: float
    R: float
    delta: float


def c(a: float, n: int) -> list[float]:
    result = [1.0]
    for j in range(1, n + 1):
        result.append(result[-1] * (1 - (a + 1) / j))
    return result


def unscented(walk: Walk, y: float, output: Callable[[float], float]) -> Walk:
    P = walk.P + walk.Q
    root = math.sqrt(3 * P)
    points = [walk.value, walk.value + root, walk.value - root]
    Y = [output(point) for point in points]
    Wm, Wc = [2 / 3, 1 / 6, 1 / 6], [8 / 3, 1 / 6, 1 / 6]
    predicted = sum(Wm[i] * Y[i] for i in range(3))
    Pyy = walk.R
    Pxy = 0.0
    for i in range(3):
        Pyy += Wc[i] * (Y[i] - predicted) ** 2
        Pxy += Wc[i] * (points[i] - walk.value) * (Y[i] - predicted)
    K = Pxy / Pyy
    correction = K * (y - predicted)
    return walk._replace(
        value=walk.value + correction,
        P=P - K * Pyy * K,
        Q=(1 - walk.delta) * walk.Q + walk.delta * correction**2,
    )


def straight_loop(
    ys: Sequence[float],
    us: Sequence[float],
    h: float,
    window: int,
    order: Walk,
    parameter: Walk,
    x0: float,
    P0: float,
    Q: float,
    R: float,
) -> list[list[float]]:
    states, variances = [x0], [P0]
    rows = []
    for k, (y, u) in enumerate(zip(ys, us, strict=True), start=1):
        L = min(k, window)

        def past(a: float, L: int = L, k: int = k) -> float:
            ca = c(a, L)
            return sum(ca[j] * states[k - j] for j in range(1, L + 1))

        x, w = states[k - 1], parameter.value
        order = unscented(order, y, lambda a, x=x, w=w, u=u: h**a * (w * x + u) - past(a))  # type: ignore[misc]
        a = order.value
        parameter = unscented(parameter, y, lambda w, x=x, a=a, u=u: h**a * (w * x + u) - past(a))  # type: ignore[misc]
        x_predicted = h**a * (w * x + u) - past(a)
        ca = c(a, L)
        P_predicted = (h**a * w + a) ** 2 * variances[k - 1] + Q
        for j in range(2, L + 1):
            P_predicted += ca[j] ** 2 * variances[k - j]
        K = P_predicted / (P_predicted + R)
        states.append(x_predicted + K * (y - x_predicted))
        variances.append((1 - K) * P_predicted)
        rows.append([states[k], variances[k], a, order.P, order.Q, parameter.value, parameter.P, parameter.Q])
    return rows


# (h, process noise, R, KFo, KFw, KFx P0, KFx Q, amplitude of the saw-tooth input): sections 6.1 and 7.1.
EXAMPLE_1 = (0.001, Walk(1, 0.05, 0.005, 1e-3, 0.5), Walk(0, 0.001, 0.01, 1e-3, 0.5), 1.0, 1e-5, 1e-3, 1.0)
GYROSCOPE = (0.01, Walk(1, 0.01, 0.1, 0.0235, 0.5), Walk(0, 0.01, 0.1, 0.0235, 0.5), 0.01, 0.15, 0.0235, 0.0)


@pytest.mark.parametrize("window", [1000, 60], ids=["full", "finite"])
@pytest.mark.parametrize("case", [EXAMPLE_1, GYROSCOPE], ids=["example 1", "gyroscope"])
def test_reference_equals_straight_loop(
    case: tuple[float, Walk, Walk, float, float, float, float], window: int
) -> None:
    h, order, parameter, P0, Q, R, amplitude = case
    n = 300
    random.seed(5)
    us = [amplitude * 2 * math.modf(5 * k * h + 0.5)[0] - amplitude for k in range(n)]
    x, ys = [0.0], []
    weights = c(0.6, n)
    for k in range(1, n + 1):
        drive = -0.3 * x[k - 1] + us[k - 1] + math.sqrt(1e-5) * random.gauss(0, 1)
        x.append(h**0.6 * drive - sum(weights[j] * x[k - j] for j in range(1, k + 1)))
        ys.append(x[k] + math.sqrt(R) * random.gauss(0, 1))

    expected = straight_loop(ys, us, h, window, order, parameter, 0.0, P0, Q, R)
    fltea = Fltea(
        System(A=lambda w: w.reshape(1, 1), B=[[1.0]], C=[[1.0]], h=h),  # type: ignore[arg-type]
        OrderSettings(P0=order.P, Q0=order.Q, alpha0=order.value, R=order.R, delta=order.delta),
        ParameterSettings(
            P0=parameter.P, Q0=parameter.Q, w0=parameter.value, R=parameter.R, delta=parameter.delta
        ),
        StateSettings(P0=P0, Q=Q, x0=0, R=R),
        window,
    )
    for y, u, row in zip(ys, us, expected, strict=True):
        step = fltea.step(y, u)
        assert [
            step.x[0],
            step.P[0, 0],
            step.order,
            step.order_variance,
            fltea.order.Q[0, 0],
            step.w[0],
            step.Pw[0, 0],
            fltea.parameter.Q[0, 0],
        ] == pytest.approx(row, rel=1e-9, abs=1e-15)
