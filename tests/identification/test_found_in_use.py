"""Tests of faults that were found in use: each of these results was wrong once."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.identification import findings
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport
from fltea.identification.lead import lead
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.model_file import NoiseModels, read_models, write_json
from fltea.identification.noise_model import AxisModel, draw
from fltea.noise.parts import Order, White
from fltea.records.fit import Interval, Level

from tests.rig.identify_files import QUICK, identify_axis
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, Truth, ar, composite, white

OPTIONS = IdentifyOptions(QUICK, shuffles=0)


def identified(y: np.ndarray) -> AxisReport:
    return identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)


def data_checks(found: AxisReport) -> dict[str, str]:
    return {
        data_check.kind: f"{data_check.severity}: {data_check.text} {data_check.remedy}"
        for data_check in found.data_checks
    }


@pytest.mark.parametrize("seed", range(5))
def test_relaxations_with_quantisation_are_not_fractional(seed: int) -> None:
    """Relaxations with quantisation noise are not fractional noise. The density of quantisation noise rises
    with frequency. In an earlier version, no model of relaxations was chosen for a density that rises
    anywhere.
    """
    truth = Truth(0.005, ((0.0175, 1.0), (0.0175, 0.1), (0.0175, 0.02)), Q=1.4e-4)
    assert identify_axis(composite(truth, 60_000, H, seed), H, None, OPTIONS).verdict.kind != "fractional"


def test_a_model_that_is_exported_is_read_again(tmp_path: Path) -> None:
    found = identified(ar((0.9,), 6000, 1, 1)[0] + white(6000, 1, 2)[0])
    models = NoiseModels(100.0, H, "a", {"gyro_x": found.model})
    write_json(tmp_path / "m.json", models)
    assert read_models(tmp_path / "m.json") == models


def test_the_table_writes_figures_as_the_first_line_does() -> None:
    """In an earlier version, the table in the output had 1.08e+03 where the first line had 1080, and the
    table's figures had fewer digits.
    """
    found = identified(white(3000, 1, 2)[0])
    level = Level(Interval(18.0, 17.9, 18.2), K_at_most=0.0071)
    found = msgspec.structs.replace(found, result=msgspec.structs.replace(found.result, level=level))
    rows = dict(findings.level_rows(found))
    assert rows["  N [deg/√h]"] == "1080 (1074 … 1092)"
    assert rows["  K [deg/h/√h]"].startswith("at most 1530")
    first = lead(found).split(" · ")
    assert {"N 1080 deg/√h (1074 … 1092)", "K at most 1530 deg/h/√h"} <= set(first)


def test_an_axis_that_is_constant_at_first_is_judged() -> None:
    """The axis is constant during the start-up window of the algorithm FLTEA, so FLTEA is not run.

    All other results exist.
    """
    y = np.concatenate([np.full(500, 0.3), white(59_500, 1, 1)[0]])
    found = identified(y)
    assert found.result.verdict.kind == "white"
    assert (found.result.fltea, found.result.fltea_other) == (None, None)
    assert "constant in the start-up window" in found.result.fltea_reason
    assert "FLTEA was not run: the axis is constant" in findings.settings(found)
    assert "stuck" in data_checks(found)
    assert not any(label.startswith("FLTEA") for label, _ in findings.rows(found))


@pytest.mark.parametrize("hz", [0.05, 1.0, 0.0])
def test_a_sensor_that_was_moved(hz: float) -> None:
    """The sensor is rocked at 30 deg/s for 30 of 120 s, or turned.

    Such motion is not reported as a spectral line, mains or motor.
    """
    t = np.arange(12_000) * H
    y = 0.1 * white(12_000, 1, 3)[0]
    moved = (t >= 40) & (t < 70)
    y[moved] += 30 * (np.sin(2 * np.pi * hz * (t[moved] - 40)) if hz else 1.0)
    found = identified(y)
    assert found.result.verdict.kind == "white"
    assert found.result.level.N.value == pytest.approx(0.01, rel=0.05)
    assert found.result.std == pytest.approx(0.1, rel=0.05)
    (span,) = found.motion
    assert (span.begin_s, span.end_s) == (pytest.approx(40, abs=0.7), pytest.approx(70, abs=1.5))
    assert span.largest == pytest.approx(30, abs=1)
    assert data_checks(found)["motion"].startswith("warning: The sensor moved from 40 to 7")
    assert not found.bias_steps


@pytest.mark.parametrize("kind", ["walk", "warming up", "bursts", "heavy tails", "slow"])
def test_noise_at_rest_is_neither_motion_nor_steps(kind: str) -> None:
    n = 120_000
    y = {
        "walk": lambda: np.cumsum(white(n, 1, 1)[0]),
        "warming up": lambda: 30 * np.exp(-np.arange(n) / 10_000) + 0.1 * white(n, 1, 2)[0],
        "bursts": lambda: white(n, 1, 3)[0] * np.where(np.arange(n) // 10_000 % 3 == 1, 8.0, 1.0),
        "heavy tails": lambda: np.random.default_rng(4).standard_t(3, n),
        "slow": lambda: ar((0.999,), n, 1, 5)[0],
    }[kind]()
    found = identified(y)
    assert not found.motion
    assert not found.bias_steps


def test_the_null_test_says_its_level() -> None:
    assert "level 0.05" in identified(white(3000, 1, 1)[0]).result.verdict.text


def test_one_record_is_said_to_be_long_enough() -> None:
    """If a record is too short, the output names only one length that would be enough.

    The data check "short" recommends ten minutes. If the verdict needs a longer record, only the verdict's
    text recommends a length.
    """
    found = identified(white(6000, 1, 1)[0])
    assert "Record ten minutes or more" in data_checks(found)["short"]
    y = draw(AxisModel((White(1.0), Order(0.5, -1.0, 10.0))), H, 20_000, np.random.default_rng(0))[0]
    found = identified(y)
    assert "ten minutes" not in data_checks(found)["short"]
    assert "Record longer, or use" in found.result.verdict.text


@pytest.mark.parametrize("y", [np.tile([1.0, 2.0], 3000), np.arange(6000.0)], ids=["alternating", "a line"])
def test_samples_without_noise(y: np.ndarray) -> None:
    with pytest.raises(ValueError, match="there is no noise in the samples to identify"):
        identify_axis(y, H, None, OPTIONS)
