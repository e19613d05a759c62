"""A page of the site in a real browser, with the theme's additions."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.rig.browser_support import Watched, browsers

HOST = Path(__file__).parents[2] / "host"
PAGE = """# A page

    one block of code

| a | b |
|---|---|
| 1 | 2 |

    another block of code
"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    yield from browsers()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_on_a_page_with_code(tmp_path: Path, chromium: Browser, scheme: str) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    for name in ("style.css", "names.js"):
        docs.joinpath(name).write_bytes((HOST / "docs" / name).read_bytes())
    docs.joinpath("index.md").write_text(PAGE)
    config = tmp_path / "mkdocs.yml"
    hooks = HOST.parent / "tools/site_hooks.py"
    config.write_text(
        f"INHERIT: {HOST / 'mkdocs.yml'}\ndocs_dir: docs\nsite_dir: site\nhooks: [{hooks}]\n"
        "nav: [{Page: index.md}]\nplugins: {search: {}}\n"
    )
    build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--config-file", os.fspath(config)]
    subprocess.run(build, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    page = Watched(chromium, (tmp_path / "site/index.html").as_uri(), color_scheme=scheme)
    page.wait("document.querySelectorAll('nav.md-code__nav').length === 2")
    assert page.violations() == []
