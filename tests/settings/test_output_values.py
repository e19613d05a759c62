"""Tests that a wrong value of a setting of outputs has an error that names it and says what it must be."""

import re
from typing import Any

import pytest
from fltea.records.errors import UsageError
from fltea.settings.config import SETTINGS, load_config
from fltea.settings.outputs import OUTPUTS, Outputs
from fltea.settings.setting import Declared
from msgspec import inspect as types

OF_OUTPUTS = [one for one in SETTINGS.values() if one.path.partition(".")[0] in Outputs.__struct_fields__]
OF_OTHER_TYPES = ({"a": 1}, [[1]], True, 2.5, 7)
"""Values of several types. No setting of outputs takes the first."""
NO_ADDRESSES = ("", " ", "[::", "a:b:c:d", "host:port", "host:99999", "host:-1", "host:8080/x?y", ":8080:")
"""Texts that are no address; settings that are none, such as a folder, may accept them."""


def error_of(path: str, value: Any) -> str | None:
    try:
        load_config(None, {path: value})
    except UsageError as error:
        return str(error)
    return None


@pytest.mark.parametrize("one", OF_OUTPUTS, ids=lambda one: f"{one.path}")
def test_a_value_of_another_type_is_refused_with_what_is_expected(one: Declared) -> None:
    free = any(isinstance(kind, types.StrType) for kind in one.kinds) and not one.setting.time
    assert one.setting.text or not free, (
        f"settings/: the `Setting` of {one.path} needs `text=`, what a text must be, such as "
        f'"the name of a file" or "HOST:PORT"; now the error says: {one.wrong(7)}'
    )
    said = {f"{value}": error_of(one.path, value) for value in OF_OTHER_TYPES}
    assert said[f"{OF_OTHER_TYPES[0]}"], f"{one.path} accepts {OF_OTHER_TYPES[0]}"
    for value, error in said.items():
        assert error in (None, f"command line: {one.path} must be {one.takes}, got {value}.")


@pytest.mark.parametrize("path", sorted({row.on for row in OUTPUTS if not row.when}))
def test_a_text_that_is_no_address_is_refused_with_what_is_expected(path: str) -> None:
    said = {value: error_of(path, value) for value in NO_ADDRESSES}
    wrong = {value: error for value, error in said.items() if error and not told(error, path)}
    assert not wrong, f"the errors name no {path}, or do not say what it must be: {wrong}"
    if "PORT" in SETTINGS[path].takes:
        accepted = [value for value in ("", "[::", "host:port", "host:99999", "host:-1") if not said[value]]
        assert not accepted, f"{path} accepts {accepted}: let `__post_init__` of its table read the address"


def told(error: str, path: str) -> bool:
    """Return whether an error names a setting, and says what it must be."""
    return bool(re.match(rf"command line: {re.escape(path)}:? (must|.*\bput\b)", error))
