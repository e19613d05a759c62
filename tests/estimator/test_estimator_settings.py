import math

import msgspec
import pytest
from fltea.settings.estimator import EstimatorConfig, OrderSettings, ParameterSettings, StateSettings


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (StateSettings, "P0", -1),
        (StateSettings, "Q", math.nan),
        (StateSettings, "x0", math.inf),
        (OrderSettings, "P0", -0.1),
        (OrderSettings, "Q0", math.inf),
        (OrderSettings, "alpha0", math.nan),
        (OrderSettings, "delta", 1.1),
        (ParameterSettings, "P0", -1),
        (ParameterSettings, "Q0", -1),
        (ParameterSettings, "f0", math.nan),
        (ParameterSettings, "delta", math.nan),
        (EstimatorConfig, "window", -1),
    ],
)
def test_impossible_values_are_named(kind: type, field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        kind(**{field: value})


@pytest.mark.parametrize(
    ("given", "path"),
    [
        ({"order": {"delta": 2}}, r"\$\.order"),
        ({"order": {"alfa0": 1}}, r"alfa0.*\$\.order"),
        ({"window": -1}, "window"),
        ({"state": {"Q": "much"}}, r"\$\.state\.Q"),
    ],
)
def test_configuration_errors_tell_the_path(given: dict, path: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=path):
        msgspec.convert(given, EstimatorConfig)
