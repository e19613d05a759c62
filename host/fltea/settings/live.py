"""Settings of the live maximum-likelihood fit and of the live bias: the table `live` of the TOML file."""

from typing import Annotated

from fltea.settings.duration import in_seconds
from fltea.settings.setting import Setting, Table

TUNED_WITHIN = 0.3
"""A fit tunes the filters only if the half-width of α's 95 % interval is at most this.

A larger limit would be worse: a fit with a wider interval is often further from the truth than the filters'
initial values. A smaller limit would be worse, too: the first fit that meets it often has an interval that is
too narrow by chance (host/docs/evaluation/live.md).
"""


class LiveConfig(Table, frozen=True):
    """Settings of the live spectrum, maximum-likelihood fit and bias of every axis."""

    on: Annotated[bool, Setting("Fit the noise live.")] = True
    period_s: Annotated[
        float | None,
        Setting(
            "Time between fits. Unset: whenever the record has grown by a hundredth, once a second at "
            "most and once a minute at least.",
            unit="s",
            least=0.1,
            most=86400,
            example=1.0,
        ),
    ] = None
    memory: Annotated[
        str | None,
        Setting(
            "Time constant with which older samples are forgotten. Unset: no samples are forgotten.",
            unit="s",
            least=10,
            most=366 * 86400,
            time=True,
            example="10min",
        ),
    ] = None
    target: Annotated[
        float,
        Setting("Half-width of α's interval for which `until_s` gives the time.", least=0.001, most=1),
    ] = 0.05
    bias_s: Annotated[
        float,
        Setting(
            "The published bias is the expected mean over this time.",
            unit="s",
            least=0.01,
            most=3600,
        ),
    ] = 1.0
    largest_step_dps: Annotated[
        float,
        Setting(
            "The largest step within a second that a gyroscope's bias can make; a larger change is motion.",
            unit="deg/s",
            above=0,
        ),
    ] = 2.0
    largest_step_ms2: Annotated[
        float,
        Setting(
            "The largest step within a second that an accelerometer's bias can make; a larger change is a "
            "tilt.",
            unit="m/s²",
            above=0,
        ),
    ] = 0.1

    @property
    def memory_s(self) -> float | None:
        """The setting `memory` in seconds."""
        return None if self.memory is None else in_seconds(self.memory)
