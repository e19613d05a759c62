"""Draw spectrum and Allan deviation of a fit as SVG, for notebooks, reports and the live page."""

from collections.abc import Mapping, Sequence

from fltea.documents.chart import HEIGHT, Curve, log_log
from fltea.records.fit import FitAllan, FitSpectrum
from fltea.records.units import FLICKER


def spectrum(
    s: FitSpectrum,
    unit: str,
    left_out: Sequence[tuple[float, float]] = (),
    board: tuple[Sequence[float], Sequence[float]] = ((), ()),
    height: int = HEIGHT,
) -> str:
    """Draw noise density and fitted model; frequency bands that were left out of the fit are grey.

    `board`: the bins that the board fitted.
    """
    title = "Spectrum (orange: fitted" + (", grey: left out" if left_out else "")
    title += ", crosses: the board's bins)" if board[0] else ")"
    curves = [Curve(s.hz, s.density, "data"), Curve(s.hz, s.model, "model")]
    return log_log(title, "frequency [Hz]", density_label(unit), curves, left_out, board, height)


def density_label(unit: str) -> str:
    """Return the axis title for noise densities of samples in `unit`."""
    return f"density [{unit}/√Hz]"


def allan(a: FitAllan, unit: str) -> str:
    """Draw the Allan deviations of the samples and of the model, and the straight lines of N, B and K.

    The Allan deviation of the samples is drawn with its intervals.
    """
    curves = [Curve(a.tau_s, a.adev, "data", a.low, a.high), Curve(a.tau_s, a.model, "model")]
    title = "Allan deviation, 95 % (orange: fitted)"
    return log_log(title, *allan_labels(unit), [*curves, *coefficients(a)])


def allan_labels(unit: str) -> tuple[str, str]:
    """Return the axis titles for an Allan deviation of samples in `unit`."""
    return "averaging time τ [s]", f"deviation [{unit}]"


def coefficients(a: FitAllan, labels: Mapping[str, str] | None = None) -> list[Curve]:
    """Return the straight lines of N, B and K in the Allan plot, as far as these figures are known.

    A line is drawn only where it lies within a factor of 2 of the curve's range. `labels`: texts for the
    legend, by name.
    """
    found = []
    for name, value, slope, read_at in (
        ("N", a.N, -0.5, 1.0),
        ("B", None if a.B is None else FLICKER * a.B, 0.0, 1.0),
        ("K", a.K, 0.5, 3.0),
    ):
        if value is not None:
            line = [(tau, value * (tau / read_at) ** slope) for tau in a.tau_s]
            seen = [(tau, y) for tau, y in line if min(a.adev) / 2 <= y <= max(a.adev) * 2]
            if len(seen) > 1:
                label = (labels or {}).get(name, "")
                found.append(
                    Curve([tau for tau, _ in seen], [y for _, y in seen], "mark", name=name, label=label)
                )
    return found
