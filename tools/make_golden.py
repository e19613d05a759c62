"""Writes tests/estimator/golden: the paper's examples 1 to 3, 200 samples each, in 50-digit arithmetic.

The files test both the reference in Python and the native engine, so this program shares no code with either.
The formulas are typed as they are printed in Macias & Sierociuk 2023, section 5 (P by subtraction, binomials
by their definition), and computed with mpmath. Two points are ambiguous in the paper. Here, the covariances
of an unscented filter include its central point (i = 0), and every sum over the past includes the oldest
state in the memory (the term with j = L(k)).

Each file has comment lines, then one line for each sample. A line begins with the inputs y and u, each the
exact value of a float. These numbers follow, with 25 digits each: x, P, α with its variance and Q, f with its
variance and Q.
"""

import random
from pathlib import Path

from mpmath import mp, mpf

SOURCE, FOLDER = "tools/make_golden.py", "tests/estimator/golden"
SAMPLES = 200
COLUMNS = "y u x P alpha alpha_P alpha_Q f f_P f_Q"

mp.dps = 50


def difference_weights(alpha: mpf, n: int) -> list[mpf]:
    """Return (-1)^j binom(alpha, j) for j = 0 to n.

    The binomials are computed by their definition, alpha (alpha-1) ... (alpha-j+1) / j!.
    """
    weights, binomial = [mpf(1)], mpf(1)
    for j in range(1, n + 1):
        binomial = binomial * (alpha - j + 1) / j
        weights.append((-1) ** j * binomial)
    return weights


class Example:
    """The paper's example (section 6.1): one state, and a memory of all past samples.

    The factors B (of the input u in the state) and C (of the state in the output y) are 1.
    """

    h = mpf("0.001")
    Q, R = mpf("1e-5"), mpf("1e-3")
    order_R = parameter_R = mpf("1e-3")
    order_delta = parameter_delta = mpf("0.5")

    def __init__(self) -> None:
        self.x, self.P = [mpf(0)], [mpf(1)]  # x[k] is the state of sample k, P[k] its variance
        self.alpha, self.order_P, self.order_Q = mpf(1), mpf("0.05"), mpf("0.005")
        self.f, self.parameter_P, self.parameter_Q = mpf(0), mpf("0.001"), mpf("0.01")

    def past(self, alpha: mpf, k: int) -> mpf:
        """Return the sum of c_j x_{k-j} for j = 1 to k, with c_j from `difference_weights`."""
        weights = difference_weights(alpha, k)
        return mp.fsum(weights[j] * self.x[k - j] for j in range(1, k + 1))

    def step(self, y: mpf, u: mpf) -> None:
        """Process sample k by the paper's three filters, in this order.

        The filters estimate the order α (section 5.1, KFo), the parameter f (5.3, KFw) and the state x (5.2,
        KFx).
        """
        k = len(self.x)
        rate = self.f * self.x[k - 1] + u

        predicted = self.order_P + self.order_Q
        spread = mp.sqrt(3 * predicted)
        points = [self.alpha, self.alpha + spread, self.alpha - spread]
        Y = [self.h**point * rate - self.past(point, k) for point in points]
        K, e, Pyy = gain(points, self.alpha, Y, y, self.order_R)
        self.alpha = self.alpha + K * e
        self.order_P = predicted - K * Pyy * K
        self.order_Q = (1 - self.order_delta) * self.order_Q + self.order_delta * K * e * e * K

        scale, past = self.h**self.alpha, self.past(self.alpha, k)
        f_before = self.f
        predicted = self.parameter_P + self.parameter_Q
        spread = mp.sqrt(3 * predicted)
        points = [self.f, self.f + spread, self.f - spread]
        Y = [scale * (point * self.x[k - 1] + u) - past for point in points]
        K, e, Pyy = gain(points, self.f, Y, y, self.parameter_R)
        self.f = self.f + K * e
        self.parameter_P = predicted - K * Pyy * K
        self.parameter_Q = (
            1 - self.parameter_delta
        ) * self.parameter_Q + self.parameter_delta * K * e * e * K

        weights = difference_weights(self.alpha, k)
        x = scale * rate - past
        F = scale * f_before + self.alpha
        P = F * self.P[k - 1] * F + self.Q
        P += mp.fsum(weights[j] ** 2 * self.P[k - j] for j in range(2, k + 1))
        K = P / (P + self.R)
        self.x.append(x + K * (y - x))
        self.P.append((1 - K) * P)


def gain(points: list[mpf], mean: mpf, Y: list[mpf], y: mpf, R: mpf) -> tuple[mpf, mpf, mpf]:
    """Return gain, innovation and the innovation's variance Pyy of an unscented filter for one unknown.

    The constants n, lambda, A and B, from which the weights of its three points follow, are 1, 2, 1 and 2
    (the paper, section 5.1).
    """
    W_mean = [mpf(2) / 3, mpf(1) / 6, mpf(1) / 6]
    W_cov = [mpf(2) / 3 + (1 - 1 + 2), mpf(1) / 6, mpf(1) / 6]
    predicted = mp.fsum(W_mean[i] * Y[i] for i in range(3))
    Pyy = mp.fsum(W_cov[i] * (Y[i] - predicted) ** 2 for i in range(3)) + R
    Pxy = mp.fsum(W_cov[i] * (points[i] - mean) * (Y[i] - predicted) for i in range(3))
    return Pxy / Pyy, y - predicted, Pyy


def inputs(number: int) -> list[tuple[float, float]]:
    """Return the inputs y_k and u_{k-1} of an example, rounded to nine decimals.

    In examples 1 and 2, u is a saw-tooth between -1 and 1, of 10 Hz.
    """
    source = random.Random(number)
    h, x, rows = 0.001, [0.0], []
    for k in range(1, SAMPLES + 1):
        alpha = 0.6 if number == 1 else 0.2 + 0.1 * k * h
        u = 2 * ((k - 1) / 100 % 1) - 1 if number < 3 else source.gauss(0, 0.1**0.5)
        u = round(u, 9)
        c, past = 1.0, 0.0
        for j in range(1, k + 1):
            c *= (j - 1 - alpha) / j
            past += c * x[k - j]
        x.append(h**alpha * (-0.3 * x[k - 1] + u + source.gauss(0, 1e-5**0.5)) - past)
        rows.append((round(x[k] + source.gauss(0, 1e-3**0.5), 9), u))
    return rows


def text(number: int) -> str:
    """Return the text of the file of one example."""
    example = Example()
    lines = [
        f"# Example {number} of section 6.1 with a full memory; made by tools/make_golden.py.",
        f"# {COLUMNS}",
    ]
    for y, u in inputs(number):
        example.step(mpf(y), mpf(u))
        values = (
            example.x[-1],
            example.P[-1],
            example.alpha,
            example.order_P,
            example.order_Q,
            example.f,
            example.parameter_P,
            example.parameter_Q,
        )
        lines.append(" ".join((repr(y), repr(u), *(mp.nstr(value, 25) for value in values))))
    return "\n".join(lines) + "\n"


def outputs(root: Path) -> dict[str, str]:
    """Return the paths and texts of the three files."""
    return {f"{FOLDER}/example_{number}.txt": text(number) for number in (1, 2, 3)}
