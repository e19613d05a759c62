"""The online filters that are evaluated: the daemon's defaults, and one changed setting at a time."""

from typing import Any, Literal

import msgspec
from fltea.settings.estimator import (
    EstimatorConfig,
    JointSettings,
    OrderSettings,
    ParameterSettings,
    StateSettings,
)

from tools.validation.evaluate.cases import POWER, Case


class Setting(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a filter with a name. `Q` and `R` say where the filter gets its Q and R.

    `config`: Q and R are those of the settings. `true`: Q and R are those of the noise, which a user does not
    know. `fitted`: Q and R come from the Whittle fit of another record of the same noise, unless this fit
    finds white noise. A user gets such values from `fltea identify`.
    """

    name: str
    config: EstimatorConfig
    R: Literal["config", "true", "fitted"] = "config"
    Q: Literal["config", "true", "fitted"] = "config"


_JOINT = EstimatorConfig()
_TRIPLE = EstimatorConfig(variant="triple")


def _with(config: EstimatorConfig, **changes: Any) -> EstimatorConfig:
    return msgspec.structs.replace(config, **changes)


WHITTLE = "Whittle"
"""Name of the maximum-likelihood fit of the whole record."""
LIVE = "live"
"""Name of the maximum-likelihood fit of the sums that the daemon keeps in place of the whole record."""

MAIN: tuple[Setting, ...] = (
    Setting("triple", _TRIPLE),
    Setting("joint", _JOINT),
    Setting("triple, R known", _TRIPLE, R="true"),
    Setting("joint, R known", _JOINT, R="true"),
    Setting("joint, Q and R known", _JOINT, R="true", Q="true"),
)
"""Settings that are run on the whole grid of noises."""

TUNED: dict[str, EstimatorConfig] = {"triple, tuned live": _TRIPLE, "joint, tuned live": _JOINT}
"""Settings that are run on the whole grid of noises, with Q and R from the live fit (module `tuned`)."""

CHANGES: tuple[Setting, ...] = (
    Setting("joint, as it is", _JOINT),
    Setting("joint, R known", _JOINT, R="true"),
    Setting("joint, Q known", _JOINT, Q="true"),
    Setting("joint, Q and R known", _JOINT, R="true", Q="true"),
    Setting("joint, Q and R fitted", _JOINT, R="fitted", Q="fitted"),
    Setting("joint, Q = 10 x the default", _with(_JOINT, state=StateSettings(Q=1.5))),
    Setting("joint, Q = variance of y", _with(_JOINT, state=StateSettings(Q=POWER))),
    Setting("joint, Q = variance of y / 4", _with(_JOINT, state=StateSettings(Q=POWER / 4))),
    Setting("joint, bias none", _with(_JOINT, bias="none")),
    Setting("joint, startup 2000", _with(_JOINT, startup=2000)),
    Setting("joint, window 300", _with(_JOINT, window=300)),
    Setting("joint, window 60000", _with(_JOINT, window=60_000)),
    Setting("joint, guard faithful", _with(_JOINT, guard="faithful")),
    Setting("joint, guard off", _with(_JOINT, guard="off")),
    Setting("joint, delta 0.5", _with(_JOINT, joint=JointSettings(delta=0.5))),
    Setting("joint, P0 0.25", _with(_JOINT, joint=JointSettings(P0=0.25))),
    Setting("joint, start 0.8 and -0.3", _with(_JOINT, joint=JointSettings(alpha0=0.8, beta0=-0.3))),
    Setting("triple, as it is", _TRIPLE),
    Setting("triple, R known", _TRIPLE, R="true"),
    Setting("triple, Q known", _TRIPLE, Q="true"),
    Setting("triple, Q and R known", _TRIPLE, R="true", Q="true"),
    Setting("triple, Q and R fitted", _TRIPLE, R="fitted", Q="fitted"),
    Setting("triple, Q = variance of y", _with(_TRIPLE, state=StateSettings(Q=POWER))),
    Setting("triple, window 300", _with(_TRIPLE, window=300)),
    Setting("triple, guard faithful", _with(_TRIPLE, guard="faithful")),
    Setting("triple, guard off", _with(_TRIPLE, guard="off")),
    Setting("triple, start 0.5", _with(_TRIPLE, order=OrderSettings(alpha0=0.5))),
    Setting(
        "triple, delta 0",
        _with(_TRIPLE, order=OrderSettings(delta=0.0), parameter=ParameterSettings(delta=0.0)),
    ),
    Setting(
        "triple, delta 0 and Q0 0",
        _with(
            _TRIPLE, order=OrderSettings(delta=0.0, Q0=0.0), parameter=ParameterSettings(delta=0.0, Q0=0.0)
        ),
    ),
)
"""Changed settings, which are run on a few noises."""

CHANGED_ON: tuple[Case, ...] = (
    Case(),
    Case(0.4, -1.0, 3.0),
    Case(0.6, -3.0, 0.3),
    Case(0.6, -3.0, 30.0),
    Case(0.8, -1.0, 0.03),
    Case(0.8, -10.0, 3.0),
)
"""The noises on which the settings in CHANGES are run."""
