"""Saves a picture of the live page, of a fleet's page or of a report, as a browser shows it.

    make run                                             # in another terminal
    url='http://127.0.0.1:5006/#axis=gyro_y'
    .venv/bin/python -m tools.page_picture "$url" host/docs/guide/dashboard.png
    .venv/bin/python -m tools.page_picture "$url" host/docs/guide/dashboard-dark.png --dark

    fltea simulate rest.csv --alpha 0.5 --f -1 -n 360000 --axes 1
    fltea identify rest.csv --forecast --report report
    url="file://$PWD/report/report.html"
    out=host/docs/guide/identify_report.png
    .venv/bin/python -m tools.page_picture "$url" "$out" --width 1180 --height 1220 --wait 1

The program needs Debian's Chromium. It waits `--wait` seconds for the page to be drawn, and prints warnings
and errors of the page on standard error.
"""

import argparse
import shutil
import sys

from playwright.sync_api import sync_playwright

ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu"]


def main() -> int:
    """Save the picture; return 1 if the page reported warnings or errors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("url")
    parser.add_argument("out", help="PNG to write")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=900)
    parser.add_argument("--dark", action="store_true")
    parser.add_argument("--whole", action="store_true", help="the whole page, not only what a window shows")
    parser.add_argument("--wait", type=float, default=9.0, metavar="S")
    asked = parser.parse_args()
    chromium = shutil.which("chromium")
    if chromium is None:
        parser.error("no Chromium: apt-get install chromium")
    complaints: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(
            viewport={"width": asked.width, "height": asked.height},
            color_scheme="dark" if asked.dark else "light",
        )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda m: complaints.append(m.text) if m.type in ("warning", "error") else None)
        page.goto(asked.url)
        page.wait_for_timeout(asked.wait * 1000)
        page.screenshot(path=asked.out, full_page=asked.whole)
        browser.close()
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
