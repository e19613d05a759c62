"""Every folder of tests is collected, although pytest by itself leaves out folders with some names."""

from fnmatch import fnmatch

import pytest

from tests.rig.host_support import ROOT


def test_no_folder_with_tests_is_left_out(pytestconfig: pytest.Config) -> None:
    left_out = pytestconfig.getini("norecursedirs")
    folders = {
        part for file in (ROOT / "tests").rglob("test_*.py") for part in file.relative_to(ROOT).parts[:-1]
    }
    assert not [folder for folder in folders for pattern in left_out if fnmatch(folder, pattern)]
