"""Tests of the declared fields of records, and that the records of a real run match them."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import pytest
from fltea.records.device_fit import DeviceAxisFit, DeviceVerdict
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate, FlteaEstimate, Whiteness, WhyNot
from fltea.records.fit import FittedAxis, VerdictKind
from fltea.records.records import (
    AXES,
    AnyRecord,
    DeviceEstimates,
    DeviceFits,
    Epoch,
    EpochReason,
    Estimate,
    Hello,
    Motion,
    Sample,
    Step,
)
from fltea.records.stats import DeviceStatus
from fltea.wire import layout as wire
from fltea.wire.messages import REASONS

from tests.rig.host_support import QUICK, ROOT, fltea_here, strict_records
from tools import site_records

SYNTHETIC = ("-s", "synthetic:?n=300")


@pytest.mark.parametrize(
    ("struct", "field", "words"),
    [
        (Epoch, "reason", get_args(EpochReason)),
        (DeviceAxisEstimate, "why_not", get_args(WhyNot)),
        (Hello, "sampling_mode", [mode.name.lower() for mode in wire.SamplingMode]),
        (AxisEstimate, "whiteness", get_args(Whiteness)),
        (DeviceStatus, "reset_cause", [cause.name.lower() for cause in wire.ResetCause]),
        (FittedAxis, "verdict", get_args(VerdictKind)),
        (DeviceAxisFit, "verdict", get_args(DeviceVerdict)),
    ],
)
def test_every_word_that_a_field_can_hold_is_in_its_text(
    struct: type, field: str, words: Sequence[str]
) -> None:
    text = site_records.texts(struct)[field]
    missing = [word for word in words if f"`{word}`" not in text]
    assert not missing, f"{struct.__module__}: the text of {struct.__name__}.{field} lacks {missing}"


def test_reasons_are_those_of_the_protocol_page() -> None:
    page = (ROOT / "protocol/README.md").read_text(encoding="utf-8")
    for reason in REASONS:
        assert f"\n| {reason} |" in page


# --- a real run matches the declarations ---

CONSTANT = "time_s,gyro_x_dps,gyro_y_dps\n" + "".join(f"{k / 100},{k % 7},1\n" for k in range(200) if k != 99)


def test_real_run_emits_only_what_its_structs_say(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text(CONSTANT)
    runs = [
        fltea_here("run", *SYNTHETIC, "--pace", "fast", "--once", "--samples", "--corrected", *QUICK),
        fltea_here("run", "-s", f"replay:{tmp_path}/rest.csv", "--once", "--samples", *QUICK),
    ]
    found = [record for run in runs for record in strict_records(run.stdout)]
    # These runs have no step, no motion, and no device that computes estimates itself. Other tests check the
    # records of such a device (test_device_estimates_outputs.py, test_device_fits.py).
    elsewhere = {DeviceEstimates, DeviceFits, Step, Motion}
    assert {type(record) for record in found} == set(get_args(AnyRecord)) - elsewhere
    for run in runs:
        assert "NaN" not in run.stdout
        assert "Infinity" not in run.stdout


def test_invalid_axis_is_null_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text(CONSTANT)
    run = fltea_here("run", "-s", f"replay:{tmp_path}/rest.csv", "--once", *QUICK)
    found = strict_records(run.stdout)
    assert isinstance(found[0], Hello)
    assert not any(isinstance(record, Sample) for record in found)
    estimates = [record for record in found if isinstance(record, Estimate)]
    assert len(estimates) == 149
    for record in estimates:
        assert [*record.axes] == list(AXES[:2])
        assert record.axes["gyro_x"].fltea.valid
        assert record.axes["gyro_y"].fltea == FlteaEstimate()
        assert record.axes["gyro_y"].null_p is None
