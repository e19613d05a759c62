"""Computes the modes (decaying sums) by which the board remembers all past samples.

It writes firmware/core/engine/fixed_nodes.hpp.

The logarithms of the modes' decay rates are equally spaced, as in firmware/core/engine/memory_nodes.hpp. But
these modes are for a memory of all past samples, not of a window. Their figures are written as integers,
because memory_fixed.hpp computes with integers.
"""

import math
from pathlib import Path

from tools.generated import rendered

SOURCE, HEADER = "tools/gen_fixed_nodes.py", "firmware/core/engine/fixed_nodes.hpp"

DIGITS = 3
HEAD = 5
HORIZON = 100_000
"""The modes have to be accurate for samples up to this age [samples], to 10^-DIGITS. HORIZON, DIGITS and HEAD
were chosen by measurements (firmware/README.md, "What it costs").
"""


def step_for(error: float) -> float:
    """Return the largest spacing of the modes with which the weights of past samples err by at most `error`.

    A mode is a sum of past samples that decays exponentially. The exact weight of a past sample is an
    integral over the logarithm of the decay rate. The modes approximate the integral by the trapezoidal rule.
    The spacing is the rule's step: the difference of the logarithms of two neighbouring decay rates.
    """
    step = 1.0
    while _alias(step) > error:
        step -= 0.005
    return step


def _alias(step: float) -> float:
    y = 2 * math.pi / step
    return 2 * math.sqrt((1 + y * y) * 2 * math.pi * y) * math.exp(-math.pi * y / 2)


def top_for(step: float, error: float) -> int:
    """Return the number n of the fastest mode (decaying sum) that is needed.

    The decay rate of mode n is exp(n · step). Mode n + 1 would contribute at most a quarter of `error`.
    """
    n, top = HEAD + 1, 0
    while True:
        p = math.exp((top + 1) * step)
        if n * (n - 1) * p**2 * (1 + p) ** -(n + 1) <= error / 4:
            return top
        top += 1


def outputs(root: Path) -> dict[str, str]:
    """Return the path and the text of the header file."""
    error = 10.0**-DIGITS
    step = step_for(error)
    top = top_for(step, error)
    count = math.ceil(top - math.log(0.8 * error ** (1 / 3) / HORIZON) / step) + 1
    nodes = [math.exp((top - i) * step) for i in range(count)]
    forget = [p / (1 + p) for p in nodes]
    weight = [-step / math.pi * (1 + p) ** -(HEAD + 1) for p in nodes]
    text = rendered(
        "fixed_nodes.hpp",
        digits=DIGITS,
        horizon=HORIZON,
        head=HEAD,
        step=round(step / math.log(2) * 2**29),
        top=round(top * step / math.log(2) * 2**29),
        ratio=round(math.exp(-step) * 2**30),
        plain=round(-step / math.pi * nodes[-1] * 2**46),
        forget=[round(x * 2**31) for x in forget],
        weight=[round(x * 2**31) for x in weight],
    )
    return {HEADER: text}
