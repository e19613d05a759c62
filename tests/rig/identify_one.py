"""Run one axis through all steps of `fltea identify`, without a recording."""

import contextlib
from collections.abc import Sequence

import msgspec
from fltea.identification.axis import IdentifyOptions, with_fltea
from fltea.identification.axis_report import AxisReport
from fltea.identification.conclusions import conclude
from fltea.identification.data_checks import DataCheck
from fltea.identification.forecast import Asked
from fltea.identification.left_out import without
from fltea.identification.load import Series
from fltea.identification.one_axis import (
    MOST_ANALYSES,
    FlteaInput,
    concluded,
    examine,
    run_fltea,
    with_events,
)
from fltea.identification.sensor_events import watch
from fltea.settings.live import LiveConfig


def identify_series(
    series: Series,
    h: float,
    options: IdentifyOptions,
    figures: bool,
    forecast: Asked = False,
    known: Sequence[DataCheck] = (),
    live: LiveConfig | None = None,
) -> AxisReport:
    """Return the identification of one axis alone.

    `fltea identify` also runs FLTEA over shuffled copies of the samples, which are white; this function does
    not. `known`: results of data checks of the whole recording.

    Raises:
        ValueError: The series is too short or constant.
    """
    found = examine(series, h, options, figures, known)
    for _ in range(1, MOST_ANALYSES):
        events = watch({"y": series}, (), {"y": found.tracked}, h, live or LiveConfig())["y"]
        if events.left_out.is_like(found.left_out):
            break
        # If too few samples remain between steps of the bias, `examine` fails, and `found` stays as it is.
        with contextlib.suppress(ValueError):
            found = examine(series, h, options, figures, known, events.left_out)
    if found.tracked is not None:
        rest, K = without(series, found.left_out), found.result.level.K
        found = concluded(
            found, conclude(rest, h, options, found.tracked, K, forecast, events.at_end, events.steps)
        )
    (fits,) = run_fltea([FlteaInput.of(series, found, options)], h)
    found = msgspec.structs.replace(found, result=with_fltea(found.result, fits))
    return with_events(found, events)
