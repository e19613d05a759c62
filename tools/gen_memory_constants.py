"""Fits a polynomial that the filters' compressed memory needs to sum the variances of past states.

It writes firmware/core/engine/memory_constants.hpp.

Let c_j(a) be the weight of the sample of age j in a fractional difference of order a, and b = a + 1. The
squared weight contains the factor 4^b B(b, b) = 2 sqrt(pi) Gamma(b) / Gamma(b + 1/2), where B is the beta
function (see engine/memory_nodes.hpp). This factor has poles near the orders in use. The recurrence
Gamma(b + 1) = b Gamma(b), used four times in the numerator and three times in the denominator, splits off
the factors b, b + 1/2, b + 1 and so on. What remains is 2 sqrt(pi) Gamma(b + 4) / Gamma(b + 7/2), whose poles
are farther away. The polynomial interpolates it at Chebyshev points, in arbitrary precision.
"""

from pathlib import Path

import mpmath

from tools.generated import rendered

SOURCE, HEADER = "tools/gen_memory_constants.py", "firmware/core/engine/memory_constants.hpp"

# Range of orders that the compressed memory supports. For an order outside this range, the memory uses the
# nearest supported order.
LOWEST_ORDER, LOWEST_VARIANCE_ORDER, HIGHEST_ORDER = "-1.95", "-1.3", "4"
DEGREE = 18


def ratio(b: mpmath.mpf) -> mpmath.mpf:
    """Return 2 sqrt(pi) Gamma(b + 4) / Gamma(b + 7/2), which the polynomial approximates."""
    return 2 * mpmath.sqrt(mpmath.pi) * mpmath.gamma(b + 4) / mpmath.gamma(b + mpmath.mpf(7) / 2)


def fit(centre: mpmath.mpf, half: mpmath.mpf) -> list[mpmath.mpf]:
    """Interpolate the function `ratio` by a polynomial, at the Chebyshev points of `centre` ± `half`.

    Return the coefficients, that of the highest power first. The polynomial's variable runs from -1 to 1 over
    this interval.
    """
    points = [mpmath.cos(mpmath.pi * (k + mpmath.mpf(1) / 2) / (DEGREE + 1)) for k in range(DEGREE + 1)]
    powers = mpmath.matrix([[t ** (DEGREE - i) for i in range(DEGREE + 1)] for t in points])
    return list(mpmath.lu_solve(powers, mpmath.matrix([ratio(centre + half * t) for t in points])))


def outputs(root: Path) -> dict[str, str]:
    """Return the path and the text of the header file."""
    with mpmath.workdps(50):
        # `centre` and `scale` are rounded to double before the fit, so that the header file has exactly the
        # values that the fit used.
        low, high = float(LOWEST_VARIANCE_ORDER) + 1, float(HIGHEST_ORDER) + 1
        centre, scale = (low + high) / 2, 2 / (high - low)
        half = 1 / mpmath.mpf(scale)
        coefficients = [float(c) for c in fit(mpmath.mpf(centre), half)]
        error = max(
            abs(mpmath.polyval(coefficients, t) / ratio(centre + half * t) - 1)
            for t in mpmath.linspace(-1, 1, 501)
        )
        bound = mpmath.nstr(error * 1.05, 1, min_fixed=0, max_fixed=0)
    text = rendered(
        "memory_constants.hpp",
        lowest=LOWEST_ORDER,
        lowest_variance=LOWEST_VARIANCE_ORDER,
        highest=HIGHEST_ORDER,
        error=bound,
        centre=centre,
        scale=scale,
        degree=DEGREE,
        coefficients=coefficients,
    )
    return {HEADER: text}
