"""Numbers from the tables and the text of Macias & Sierociuk 2023 (Acta Mechanica et Automatica 17(2)).

All errors are sums of squared errors (SSE) over a whole run. The error of the state is in the square of the
state's unit, the error of the order has no unit, and the error of the parameter is in s^-2α.
"""

from typing import NamedTuple


class Errors(NamedTuple):
    """The errors in one row of tables 2 to 5, in the order of the columns."""

    state: float
    parameter: float
    order: float


QUANTITIES = Errors._fields

# The paper's section 6.1: step [s], number of samples, and the variances of process and measurement noise.
H, SAMPLES = 1e-3, 4000
NOISE_Q, NOISE_R = 1e-5, 1e-3
PARAMETER = -0.3

# The paper's section 7.1: step [s], number of samples (30 s), and R of the axes x, y, z [(deg/s)²].
GYRO_H, GYRO_SAMPLES = 1e-2, 3000
GYRO_R = {"x": 0.0235, "y": 0.0178, "z": 0.0191}
GYRO_LENGTHS = (3000, 1500)

TABLE_1 = {4000: 230.75, 3000: 218.76, 2500: 195.30, 2000: 183.55}
"""For each length L, the time for the 4,000 samples of example 1 [s] (MATLAB 2021b, Core i7-5500U)."""

TABLE_2 = {
    4000: Errors(0.2179, 37.8467, 62.7249),
    3000: Errors(0.2175, 38.1044, 62.7476),
    2500: Errors(0.2180, 38.6321, 62.8327),
    2000: Errors(0.2170, 39.8187, 62.9066),
}
TABLE_3 = {4000: Errors(0.1635, 34.8872, 1663.2), 2000: Errors(0.1634, 35.0478, 1663.1)}
TABLE_4 = {4000: Errors(0.4711, 738.2196, 1875.8), 2000: Errors(0.4831, 744.9644, 1902.9)}
TABLE_5 = {
    "x": Errors(1.79e-8, 2.16e-7, 5.09e-8),
    "y": Errors(3.29e-8, 2.52e-5, 1.08e-6),
    "z": Errors(6.52e-9, 1.62e-6, 7.36e-8),
}
"""For each axis, the sum of squared differences between the estimates at L = 3000 and those at L = 1500."""

GYRO_SETTLED = {"x": (0.3, -1.6), "y": (0.3, -1.5), "z": (0.3, -2.0)}
"""For each axis, order and parameter at the end of the run, as stated in the paper's section 7.2."""

SAMPLES_PER_SECOND = SAMPLES / TABLE_1[4000]
"""The paper's speed at L = 4000: 17.3 samples per second."""
