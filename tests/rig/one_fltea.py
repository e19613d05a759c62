"""Run the algorithm FLTEA over one axis, in the variant that the settings name."""

from fltea.identification.fltea_fit import FlteaAxis, FlteaFit, fltea_fits
from fltea.identification.gaps import Gaps, no_gaps
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import Innovations


def fltea_fit(
    y: Array,
    h: float,
    config: EstimatorConfig,
    lsb: float | None = None,
    gaps: Gaps | None = None,
    order: Interval | None = None,
) -> tuple[FlteaFit, Innovations | None]:
    """Return the last estimates of the filters, and the result of the test whether their innovations are
    white.
    """
    (found,) = fltea_fits([FlteaAxis(y, gaps or no_gaps(), config, lsb, order)], h)
    assert found.own is not None, found.reason
    return found.own, found.innovations[config.variant]
