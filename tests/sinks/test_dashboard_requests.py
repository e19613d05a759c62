"""Tests of the live page's buttons. Only our own page may use them, and each has its effect."""

import base64
import html
import json
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest
import yaml
from fltea.records.errors import UsageError
from fltea.records.fit import AxisFit
from fltea.records.ports import RecordingView
from fltea.records.records import Fit, Hello
from fltea.settings.outputs import DashboardConfig
from fltea.sinks.page import recording
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.requests import NOT_ALLOWED
from fltea.sinks.page.sink import DashboardSink
from fltea.sinks.web.handler import BY_SCRIPT

from tests.rig.dashboard_support import records
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE, with_curves, with_fits
from tests.rig.host_support import Answer, ask, port_of

AXES = {"gyro_x": with_curves(FRACTIONAL), "gyro_y": with_curves(WHITE, 2.0), "gyro_z": UNDECIDED}


class Fake:
    """A recorder that records nothing, and remembers each request."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, bool]] = []
        self.fail = ""

    def view(self, device: str) -> RecordingView:
        return RecordingView(False, False, "/somewhere")

    def start(self, device: str, hello: Hello | None) -> None:
        if self.fail:
            raise UsageError(self.fail)
        self.asked.append(("on", device, hello is not None))

    def stop(self, device: str) -> None:
        self.asked.append(("off", device, False))


class Served:
    """A server of the live page with a fake recorder, and requests to this server."""

    def __init__(self, **settings: object) -> None:
        self.fake = Fake()
        config = DashboardConfig(address=0, **settings)  # type: ignore[arg-type]
        self.sink = DashboardSink(config, {"due": "host"}, lambda *a: None, self.fake)
        self.port = port_of(self.sink.url)

    def ask(self, method: str, path: str, **headers: str) -> Answer:
        return ask(self.port, path, method, **{BY_SCRIPT: "1", **headers})

    def hear(self, axes: dict[str, AxisFit] = AXES, **of_hello: str) -> list[Fit]:
        """Give the page the records of a device, with live fits of these axes."""
        found = with_fits(records("n=600"), axes) if axes else records("n=600")
        for record in found:
            changes = of_hello if isinstance(record, Hello) else {}
            self.sink.write(msgspec.structs.replace(record, device="due", **changes))
        return [r for r in found if isinstance(r, Fit)]


def test_the_page_is_for_those_who_know_the_password(tmp_path: Path) -> None:
    secret = tmp_path / "page"
    secret.write_text("me:hunter2\n")
    secret.chmod(0o600)
    served = Served(password_file=str(secret))
    good = "Basic " + base64.b64encode(b"me:hunter2").decode()
    paths = "/", "/state?device=due", "/report.html?device=due"
    try:
        assert served.ask("GET", "/", Authorization=good).status == 200
        # the test requests all paths at the same time, since the server delays the answer to a request
        # without the right password
        with ThreadPoolExecutor(len(paths)) as pool:
            assert [*pool.map(lambda path: served.ask("GET", path).status, paths)] == [401] * len(paths)
    finally:
        served.sink.close()
    secret.chmod(0o644)
    with pytest.raises(UsageError, match=r"dashboard\.password_file .*(chmod|read)"):
        Served(password_file=str(secret))


@pytest.fixture(scope="module")
def server() -> Iterator[Served]:
    made = Served()
    yield made
    made.sink.close()


@pytest.fixture
def served(server: Served) -> Served:
    """Return a server that the tests share, without requests and events from earlier tests."""
    server.fake.asked, server.fake.fail = [], ""
    server.sink._histories["due"] = DeviceHistory("due", "host")
    return server


# --- access ---


def test_no_other_site_presses_the_buttons_and_none_reads_the_files(served: Served) -> None:
    """A page of another site cannot use the buttons. It cannot send our own header, and the browser states
    the page's origin in the request.
    """
    served.hear()
    record = "/recording?device=due&want=on"
    assert ask(served.port, record, "POST").status == 403
    assert ask(served.port, f"{record}&{BY_SCRIPT}=1", "POST").status == 403
    for method, path in (
        ("POST", record),
        ("GET", "/report.html?device=due"),
        ("GET", "/imu.yaml?device=due"),
        ("GET", "/state?parts=now:"),
    ):
        for origin in ("http://evil.example", f"http://evil.example:{served.port}", "null"):
            assert served.ask(method, path, Origin=origin)[0] == 403
        assert served.ask(method, path, Host=f"evil.example:{served.port}")[0] == 421
        assert served.ask("OPTIONS", path, Origin="http://evil.example")[0] == 403
        assert served.fake.asked == []
    own = f"http://127.0.0.1:{served.port}"
    assert served.ask("POST", record, Origin=own)[0] == 204


def test_no_get_changes_anything_and_no_nonsense_does(served: Served) -> None:
    assert served.ask("GET", "/recording?device=due&want=on")[0] == 405
    wrong = {"device=due": 400, "device=due&want=x": 400, "device=no&want=on": 404, "": 404}
    for query, status in wrong.items():
        assert served.ask("POST", f"/recording?{query}")[0] == status
    assert served.fake.asked == []


@pytest.mark.parametrize(
    ("settings", "may"),
    [
        ({"address": 5006}, True),
        ({"address": "[::1]:5006"}, True),
        ({"address": "localhost:5006"}, True),
        ({"address": "0.0.0.0:5006"}, False),
        ({"address": "192.168.1.7:5006"}, False),
        ({"address": 5006, "names": ("lab.example.org",)}, False),
        ({"address": "0.0.0.0:5006", "record": True}, True),
        ({"address": 5006, "record": False}, False),
    ],
)
def test_pages_that_others_reach_may_record_only_if_somebody_says_so(
    settings: dict[str, object], may: bool
) -> None:
    assert DashboardConfig(**settings).may_record is may  # type: ignore[arg-type]


def test_where_pages_may_not_record_they_are_told() -> None:
    closed = Served(record=False)
    try:
        status, text, _ = closed.ask("POST", "/recording?device=due&want=on")
        assert (status, text) == (403, f"{NOT_ALLOWED}\n")
        assert closed.fake.asked == []
    finally:
        closed.sink.close()


# --- recording ---


def test_button_starts_and_stops_with_what_the_device_said(served: Served) -> None:
    served.hear()
    assert served.ask("POST", "/recording?device=due&want=on")[0] == 204
    assert served.ask("POST", "/recording?device=due&want=off")[0] == 204
    assert served.fake.asked == [("on", "due", True), ("off", "due", False)]


def test_what_cannot_be_recorded_is_said_in_words(served: Served) -> None:
    served.fake.fail = "--record /x: no permission to write into this folder."
    status, text, headers = served.ask("POST", "/recording?device=due&want=on")
    assert (status, text) == (409, f"{served.fake.fail}\n")
    assert headers["Content-Type"].startswith("text/plain")


VIEW = RecordingView(True, False, "/data", "due_1.mcap", 1_234_567, 60.0, free_bytes=12_300_000_000)
OFF = RecordingView(False, False, "/data")
DONE = RecordingView(False, False, "/data", "a.mcap", 12_345, free_bytes=999_600_000_000)
BROKEN = VIEW._replace(trouble="recording to /data stopped: No space left on device.", lost=1234)
YOUNG = VIEW._replace(lost=3, seconds=5.0, free_bytes=None)
SO_FAR = "Recording to /data/due_1.mcap: 1.23 MB so far, 74.1 MB an hour, 12.3 GB free."
RECORDED = "Recorded 12.3 kB in /data/a.mcap. Recordings go to /data, 1.0 TB free."
NOT = "NOT recording: recording to /data stopped: No space left on device. 1,234 items were not recor"


@pytest.mark.parametrize(
    ("view", "may", "level", "can", "text"),
    [
        (VIEW, True, "good", True, SO_FAR),
        (OFF, True, "plain", True, "Recordings go to /data."),
        (DONE, True, "good", True, RECORDED),
        (BROKEN, True, "bad", True, NOT),
        (YOUNG, True, "bad", True, "3 items were not recorded."),
        (VIEW._replace(fixed=True), True, "good", False, "It ends with the program (--record)."),
        (OFF._replace(why_not="This source is a recording already."), True, "plain", False, "already."),
        (OFF, False, "plain", False, "--set dashboard.record=true"),
        (VIEW, False, "good", False, "Recording to /data/due_1.mcap"),
    ],
)
def test_recording_in_words(view: RecordingView, may: bool, level: str, can: bool, text: str) -> None:
    said = recording.words(view, may)
    assert (said["level"], said["can"], said["on"]) == (level, can, view.on)
    assert text in said["text"]
    for facts in (said, recording.nothing()):
        assert json.loads(json.dumps(facts, allow_nan=False)) == facts


# --- downloads ---


def test_report_holds_fit_curves_counts_settings_and_times(served: Served) -> None:
    last = served.hear()[-1]
    status, text, headers = served.ask("GET", "/report.html?device=due")
    assert status == 200
    name = re.fullmatch(
        r'attachment; filename="(fltea_due_\d{8}T\d{6}Z\.html)"', headers["Content-Disposition"]
    )
    assert name is not None
    data = re.search(r'<script type="application/json" id="fit">(.*?)</script>', text, re.DOTALL)
    found = msgspec.json.decode(data[1], type=Fit)
    assert found.axes == AXES
    assert (found.seq, found.samples) == (last.seq, last.samples)
    plain = html.unescape(
        re.sub(r"<[^>]+>", " ", re.sub(r"<(script|style).*?</\1>", "", text, flags=re.DOTALL))
    )
    for fit in AXES.values():
        assert fit.text in plain
    assert "0.132 deg/√h" in plain
    assert "α ± 0.05 in about 10 min" in plain
    assert "256 samples in knocks" in plain
    assert "lost samples" in plain
    assert "variant" in plain
    assert "epoch 1 begins" in plain
    row = re.search(r"<tr><th>α</th>(.*?)</tr>", text)
    cells = re.findall(r"<td>(.*?)</td>", row[1])
    assert cells == ["0.803 (0.762 … 0.847)", "undefined", "0.66 (0.41 … 0.97)"], "of white noise none"
    assert text.count("<svg ") == 4, "spectrum and Allan deviation of two axes"
    without_scripts = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    links = re.findall(r'(?:src|href)="([^"]*)"', without_scripts)
    assert links == [], "complete in itself"
    assert not re.search(r"<script[^>]*\ssrc=", text)


def test_texts_of_a_device_are_text_in_the_report(served: Served) -> None:
    fit = msgspec.structs.replace(WHITE, text="<img src=x></script>")
    served.hear({"gyro_x": fit}, sensor="<img src=x onerror=alert(1)>")
    text = served.ask("GET", "/report.html?device=due")[1]
    assert "<img" not in text
    assert "&lt;img" in text


def test_imu_yaml_is_as_identify_writes_it(served: Served) -> None:
    served.hear()
    status, text, headers = served.ask("GET", "/imu.yaml?device=due")
    assert status == 200
    assert headers["Content-Disposition"].endswith('_imu.yaml"')
    found = yaml.safe_load(text)
    assert set(found) == {"gyroscope_noise_density", "update_rate", "rostopic"}
    assert found["gyroscope_noise_density"] == pytest.approx(2 * 2.2e-3 * 3.141592653589793 / 180)
    assert found["update_rate"] == 100
    assert "of gyro_y" in text
    assert (
        "# gyroscope_random_walk:  # rad/s^2/sqrt(Hz); not known: the Allan deviation does not show it"
        in text
    )
    assert "fit of 599 samples" in text


def test_without_a_fit_there_is_nothing_to_take_home(served: Served) -> None:
    served.hear({})
    for path in ("/report.html?device=due", "/imu.yaml?device=due"):
        status, text, _ = served.ask("GET", path)
        assert status == 409
        assert "no fit yet" in text


def test_without_an_allan_deviation_there_is_a_report_and_no_yaml(served: Served) -> None:
    served.hear({"gyro_x": WHITE})
    assert served.ask("GET", "/report.html?device=due")[0] == 200
    status, text, _ = served.ask("GET", "/imu.yaml?device=due")
    assert (status, "no Allan deviation" in text) == (409, True)
