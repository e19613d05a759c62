"""Tests of `fltea fleet` as a user runs it, with a real MQTT broker, which has its usual limits, and a real
browser.
"""

import base64
import contextlib
import json
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from tests.rig.browser_support import PATIENCE_MS, Watched
from tests.rig.host_support import PATIENCE_S, ROOT, fltea_here, wait_until
from tests.rig.mosquitto_support import Mosquitto, Stage, make_authority
from tests.rig.toolchain import needed
from tools.faults.program import Program
from tools.faults.server import Server, free_port

SENSORS = 200
HOSTILE = "<img src=x onerror=alert(1)>"


class Running(Program):
    """The running command `fltea fleet`, and requests to its page."""

    def __init__(self, broker: Mosquitto, *arguments: str | Path) -> None:
        super().__init__(["fleet", "--mqtt", f"127.0.0.1:{broker.port}", "--listen", "0", *arguments])
        self.wait_for(lambda: "the fleet is at" in self.stderr, "the page")
        found = re.search(r"http://\S+:(\d+)/", self.stderr)
        self.url = found[0]

    def ask(self, path: str, **headers: str) -> Any:
        request = urllib.request.Request(self.url + path, headers=headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.load(answer)

    def refused(self, path: str, **headers: str) -> int:
        with pytest.raises(urllib.error.HTTPError) as refused:
            self.ask(path, **headers)
        refused.value.close()
        return refused.value.code


Start = Callable[..., Running]


@pytest.fixture
def broker(stage: Stage) -> Mosquitto:
    return stage.broker(usual_limits=True)


@pytest.fixture
def start(stage: Stage, broker: Mosquitto) -> Start:
    def make(*arguments: str | Path) -> Running:
        running = Running(broker, *arguments)
        stage.callback(running.kill)
        return running

    return make


def load(port: int, sensors: int = SENSORS, rounds: int = 1) -> dict[str, Any]:
    command = [sys.executable, "-m", "tools.fleet_load", "--port", str(port), "--every", "0"]
    command += ["--sensors", str(sensors), "--rounds", str(rounds)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.slow
def test_of_200_sensors_the_three_bad_ones_stand_out(
    stage: Stage, broker: Mosquitto, start: Start, tmp_path: Path, chromium: Browser
) -> None:
    """Before the fleet connects, the broker has the retained messages of all sensors.

    The broker would drop most of them if the fleet requested all at once.
    """
    assert load(broker.port)["acknowledged"] == 4 * SENSORS
    said = {"hello": {"rate_hz": 100.0, "sensor": HOSTILE}, "status": {"status": "online", "source": HOSTILE}}
    stranger = stage.client(broker.port)
    for kind, content in {**said, "fit": {}}.items():
        sent = stranger.publish(f"fltea/{HOSTILE}/{kind}", json.dumps(content), qos=1, retain=True)
        sent.wait_for_publish(PATIENCE_S)
    running = start("--history", tmp_path / "fleet.db", "--compare-every", "500ms")
    wait_until(lambda: sum(running.ask("api/summary")["axes"].values()) == 3 * SENSORS, "all fits")
    wait_until(lambda: len({one["device_id"] for one in running.ask("api/summary")["odd"]}) == 3, "a look")
    found = running.ask("api/summary")
    assert {int(one["device_id"], 16) for one in found["odd"]} == {3, 31, 57}
    assert (found["sensors"], found["fits"], found["connected"]) == (SENSORS + 1, SENSORS, True)
    watched = Watched(chromium, running.url)
    page = watched.page
    page.wait_for_selector("body[data-ready=yes]")
    # The page lists this sensor twice, with N and with the density of its white noise.
    assert page.locator("#odd li").count() == len(found["odd"])
    page.fill("#words", "odd")
    expect(page.locator("#total")).to_have_text("1 to 3 of 3", timeout=PATIENCE_MS)
    page.fill("#words", "onerror")
    expect(page.locator("#total")).to_have_text("1 to 1 of 1", timeout=PATIENCE_MS)
    assert HOSTILE in page.locator("#table").inner_text()
    page.locator("#table a").click()
    expect(page.locator("#sensor-head")).to_have_text(HOSTILE, timeout=PATIENCE_MS)
    page.locator("#odd a").first.click()
    expect(page.locator("#sensor-body h3")).to_have_count(3, timeout=PATIENCE_MS)
    assert page.locator("img").count() == 0
    for width, scheme in ((1280, "light"), (390, "dark")):
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme)
        assert watched.violations() == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert watched.complaints == []
    assert running.end(signal.SIGINT)[0] == 0


@pytest.mark.slow
def test_alerts_are_published_and_a_broker_that_went_comes_back(
    stage: Stage, broker: Mosquitto, start: Start
) -> None:
    heard: list[tuple[str, Any]] = []
    load(broker.port, sensors=70)
    stage.client(
        broker.port,
        on_message=lambda client, data, m: heard.append((m.topic, json.loads(m.payload))),
        on_connect=lambda client, *_: client.subscribe("fltea/fleet/#"),
    )
    running = start("--compare-every", "200ms")
    wait_until(lambda: sum(topic == "fltea/fleet/alert" for topic, _ in heard) == 4, "alerts")
    wait_until(lambda: '"count": 4' in json.dumps(heard), "the list of alerts")
    told = [alert for topic, alert in heard if topic == "fltea/fleet/alert"]
    assert {(alert["state"], alert["kind"]) for alert in told} == {("raised", "outlier")}
    assert {int(alert["device_id"], 16) for alert in told} == {3, 31, 57}
    lists = [content for topic, content in heard if topic == "fltea/fleet/alerts"]
    assert (lists[0], lists[-1]["count"]) == ({"count": 0, "dropped": 0, "alerts": []}, 4)
    assert {alert["kind"] for alert in lists[-1]["alerts"]} == {"outlier"}
    assert (
        f'fltea_fleet_alerts{{kind="outlier"}} {len(told)}.0'
        in urllib.request.urlopen(running.url + "metrics").read().decode()
    )
    broker.stop()
    wait_until(lambda: not running.ask("api/summary")["connected"], "the loss")
    broker.start()
    wait_until(lambda: running.ask("api/summary")["connected"], "the broker")
    load(broker.port, sensors=70, rounds=3)
    wait_until(lambda: running.ask("api/summary")["fits"] == 70 + 2 * 70, "new fits")
    assert running.ask("api/summary")["outages"] == 1
    before = len(lists)
    lists = [content for topic, content in heard if topic == "fltea/fleet/alerts"]
    assert len(lists) > before  # A broker that has lost its retained messages gets them again.
    assert running.stderr.count("broker_lost") == 1


def test_the_page_is_for_those_who_know_the_password(start: Start, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("me:hunter2:x\n")
    secret.chmod(0o600)
    running = start("--password-file", secret)
    good = "Basic " + base64.b64encode(b"me:hunter2:x").decode()
    assert running.ask("api/summary", Authorization=good)["sensors"] == 0
    bad = ("", "Basic", "Basic !!!", "Basic \xe9", good[:-4], "Bearer x")
    with ThreadPoolExecutor(len(bad)) as pool:  # The server delays the answer to a wrong password.
        answers = list(pool.map(lambda one: running.refused("api/summary", Authorization=one), bad))
    assert answers == [401] * len(bad)
    assert running.refused("", Host="evil.example", Authorization=good) == 421
    assert running.refused("", Origin="http://evil.example", Authorization=good) == 403
    assert running.refused("nothing", Authorization=good) == 404
    for query in ("sort=x", "order=sideways", "begin=-1", "count=9999999999"):
        assert running.refused(f"api/table?{query}", Authorization=good) == 400
    assert running.refused("api/sensor?device=x", Authorization=good) == 404


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no broker is named"),
        (["--mqtt", "x", "--listen", "0.0.0.0:0"], "others could see the page without a password"),
        (["--mqtt", "x", "--listen", "x:y"], "--listen"),
        (["--mqtt", "x", "--keep", "soon"], "--keep"),
        (["--mqtt", "x", "--keep", "30"], "--keep 30: give a time with its unit"),
        (["--mqtt", "x", "--silent-after", "0s"], "has to be longer"),
        (["--export", "o.parquet", "--history", "f.db", "--mqtt", "x"], "asks no broker"),
        (["--export", "o.parquet", "--history", "f.db", "--json"], "asks no broker"),
        (["--mqtt", "x", "--every", "3s"], "--every needs --json"),
        (["--mqtt", "x", "--password-file", "gone"], "cannot be read"),
        (["--mqtt", "x", "--set", "live.on=false"], "settings of [mqtt] only"),
        (["--mqtt", "x", "--max-sensors", "0"], "give 1 or more"),
        (["--mqtt", "x", "--history", "a", "--postgres", "b"], "not both"),
    ],
)
def test_mistakes(arguments: list[str], words: str) -> None:
    done = fltea_here("fleet", *arguments)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr


def test_the_example_of_a_broker_lets_a_device_write_under_its_own_name_only(
    stage: Stage, tmp_path: Path
) -> None:
    """The files of tools/deploy/mosquitto are used unchanged, except for folders and port."""
    authority, port = tmp_path / "authority", free_port()
    ca = make_authority(authority)
    example = ROOT / "tools/deploy/mosquitto"
    for user in ("a", "b", "fleet"):
        new = ["-c"] if user == "a" else []
        command = [
            needed("mosquitto_passwd", "mosquitto"),
            "-b",
            *new,
            str(authority / "passwords"),
            user,
            f"{user}-secret",
        ]
        subprocess.run(command, check=True, capture_output=True)
    (authority / "acl").write_bytes((example / "acl").read_bytes())
    for name in ("acl", "passwords"):
        (authority / name).chmod(0o600)
    text = (example / "fltea.conf").read_text().replace("/etc/mosquitto/fltea", str(authority))
    text = text.replace("/var/lib/mosquitto/", f"{tmp_path}/").replace(
        "listener 8883", f"listener {port} 127.0.0.1"
    )
    (tmp_path / "conf").write_text(text + ("user root\n" if os.geteuid() == 0 else ""))
    server = Server([needed("mosquitto"), "-c", tmp_path / "conf"], [port], tmp_path / "log")
    stage.callback(server.kill)
    heard: list[str] = []
    subscribed: list[object] = []
    reasons: dict[int, str] = {}
    stage.client(
        port,
        login=("fleet", "fleet-secret"),
        ca=ca,
        on_connect=lambda client, *_: client.subscribe("fltea/#", qos=1),
        on_subscribe=lambda *_: subscribed.append(_),
        on_message=lambda client, data, message: heard.append(message.topic),
    )
    wait_until(lambda: bool(subscribed), "the subscription")

    def answered(client: object, data: object, mid: int, reason: Any, properties: object) -> None:
        reasons[mid] = reason.getName()

    a = stage.client(port, login=("a", "a-secret"), ca=ca, on_publish=answered)
    mids = {topic: a.publish(topic, b"{}", qos=1).mid for topic in ("fltea/b/fit", "x", "fltea/a/fit")}
    wait_until(lambda: len(reasons) == 3, "answers")
    wait_until(lambda: bool(heard), "what is allowed")
    assert {topic: reasons[mid] for topic, mid in mids.items()} == {
        "fltea/b/fit": "Not authorized", "x": "Not authorized", "fltea/a/fit": "Success",
    }  # fmt: skip
    assert heard == ["fltea/a/fit"]


@pytest.mark.long
def test_numbers_for_a_script_and_no_broker(
    broker: Mosquitto, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    load(broker.port, sensors=30)
    command = [sys.executable, "-m", "fltea", "fleet", "--mqtt", f"127.0.0.1:{broker.port}", "--json"]
    history = tmp_path / "fleet.db"
    done = subprocess.run(
        [*command, "--history", history], capture_output=True, text=True, timeout=PATIENCE_S
    )
    with contextlib.closing(sqlite3.connect(history)) as database:
        assert database.execute("SELECT count(*) FROM fit").fetchone() == (90,)
    found = json.loads(done.stdout)
    assert (done.returncode, found["sensors"], sum(found["axes"].values())) == (0, 30, 90)
    monkeypatch.setattr("fltea.cli.fleet.FIRST_S", 0.2)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        done = fltea_here("fleet", "--mqtt", f"127.0.0.1:{nobody.getsockname()[1]}", "--json")
    assert (done.returncode, "nobody listens there" in done.stderr) == (1, True)
