"""Show the live page in a real browser: Chromium from Debian's package."""

import functools
import shutil
from collections.abc import Iterator
from importlib import resources
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from tests.rig.toolchain import missing
from tools.faults.program import wait_until

CHROMIUM = shutil.which("chromium")
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE_MS = 60_000
SEQ = "document.documentElement.dataset.seq"


def browsers() -> Iterator[Browser]:
    if CHROMIUM is None:
        missing("no Chromium: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


class Watched:
    """A page in the browser, with its requests and the errors that the browser reported."""

    def __init__(self, browser: Browser, url: str, **context: Any) -> None:
        self.page: Page = browser.new_context(**context).new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda websocket: self.requests.append(websocket.url))
        self.page.on("pageerror", lambda error: self.complaints.append(error.stack or str(error)))
        self.page.on(
            "console",
            lambda m: self.complaints.append(m.text) if m.type in ("warning", "error") else None,
        )
        self.page.goto(url)

    def wait(self, condition: str) -> None:
        """Wait until a JavaScript expression is true.

        The browser library has a function for this, but it injects a script, which the live page forbids.
        """
        wait_until(lambda: self.page.evaluate(condition), condition)

    def wait_for_seq(self, least: int) -> None:
        self.wait(f"Number({SEQ}) >= {least}")

    def violations(self) -> list[str]:
        """Return the violations that axe-core finds in the page, each with its rule and element."""
        self.page.evaluate(axe())
        found = self.page.evaluate("axe.run({resultTypes: ['violations']})")["violations"]
        return [
            f"{one['id']}: {node['target']} {node['failureSummary']}"
            for one in found
            for node in one["nodes"]
        ]


@functools.cache
def axe() -> str:
    """Return the script of axe-core, which checks the accessibility of a page."""
    return resources.files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
