"""The rows of `OUTPUTS` as parameters of tests, and the settings that switch an output on."""

from typing import Any

import pytest
from fltea.settings.config import SETTINGS, TABLES
from fltea.settings.outputs import OUTPUTS, Output


def switched_on(output: Output) -> dict[str, Any]:
    """Return the setting that switches an output on, with a value that does it."""
    return {output.on: output.when[0] if output.when else SETTINGS[output.on].setting.example}


def missing_in(output: Output) -> list[str]:
    """Return what an output's row, or the setting that switches the output on, lacks, in words."""
    row = f"settings/outputs.py, OUTPUTS: the row {output.module}"
    if output.on not in SETTINGS:
        return [f"{row} is switched on by {output.on}, and no field of `Outputs` has a setting of this path"]
    table, _, name = output.on.rpartition(".")
    kind, setting = type(TABLES[table]), SETTINGS[output.on].setting
    file = f"{kind.__module__.removeprefix('fltea.').replace('.', '/')}.py"
    begin = f"{row} is switched on by {output.on}; {file}: the `Setting` of {kind.__name__}.{name} needs "
    found = []
    if not output.when and setting.example is None:
        found.append(f"{begin}`example=`, a value with which tests and documents switch the output on")
    if not setting.flags:
        found.append(f"{begin}`flags=`, the flag of `fltea run` that switches the output on")
    return found


MISSING = [text for output in OUTPUTS for text in missing_in(output)]
"""What the rows lack. `tests/service/test_output_table.py` says it."""

EACH_OUTPUT = pytest.mark.parametrize(
    "output", [] if MISSING else OUTPUTS, ids=lambda output: f"{output.module}"
)
"""Every row. While a row lacks something, there is none, so that one failure says what is missing."""
