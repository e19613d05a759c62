"""The command `fltea fleet`."""

import contextlib
import signal
import stat
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fltea.cli.option_groups import takes_groups
from fltea.cli.output import escaped, say
from fltea.cli.setting_flags import ConfigFile, takes_settings
from fltea.cli.standard_output import silence_stdout
from fltea.process.interrupted import Interrupted, interrupt
from fltea.records.errors import FlteaError, UsageError
from fltea.records.whole_file import check_outputs
from fltea.settings import duration
from fltea.settings.extras import load
from fltea.settings.login_file import read_login
from fltea.settings.outputs import is_loopback, listen_address

if TYPE_CHECKING:
    from tornado.ioloop import IOLoop

    from fltea.fleet.program import Fleet, Plan
    from fltea.settings.mqtt import MqttConfig

SETTLED_S = 1.0
"""After this time without a message, the broker is assumed to have sent all retained messages [s]."""

FIRST_S = 10.0
"""Longest wait for the broker's answer with --json [s]."""


@dataclass(frozen=True)
class PageOptions:
    """The address of the fleet's web page, and who may see the page."""

    listen: Annotated[
        str,
        typer.Option(
            metavar="[HOST:]PORT", help="Address of the page; without a host for this machine only."
        ),
    ] = "5007"
    password_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File with one line, USER:PASSWORD, that the page asks for; not readable by others.",
        ),
    ] = None
    no_password: Annotated[
        bool,
        typer.Option("--no-password", help="Let everybody in, also from other machines."),
    ] = False
    name: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A further host name that browsers may use, such as a proxy's."),
    ] = None

    def address(self) -> tuple[str, int]:
        """Return host and port.

        Raises:
            UsageError: the text is no address.
        """
        try:
            return listen_address(self.listen)
        except ValueError as error:
            raise UsageError(f"--listen {self.listen}: {error}.") from error

    def password(self, host: str) -> str | None:
        """Return USER:PASSWORD, the login that the page on `host` asks for; None if it needs no login.

        Raises:
            UsageError: the file cannot be used, or the page would be open to others by mistake.
        """
        if self.password_file is not None:
            return ":".join(read_login("--password-file", self.password_file))
        if not self.no_password and not is_loopback(host):
            raise UsageError(
                f"--listen {self.listen}: others could see the page without a password. Give "
                "--password-file FILE (and put a proxy with TLS in front), or --no-password if everybody may "
                "see it."
            )
        return None


@dataclass(frozen=True)
class HistoryOptions:
    """Where the history of fits and alerts is kept, and for how long."""

    history: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep the history in this SQLite file; default: in memory."),
    ] = None
    postgres: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Keep the history in PostgreSQL: `postgresql://USER@HOST/DATABASE`; the password comes from "
            "PGPASSWORD or ~/.pgpass.",
        ),
    ] = None
    history_every: Annotated[
        str,
        typer.Option(
            metavar="TIME", help="Least time between kept fits of an axis; a new verdict is always kept."
        ),
    ] = "10min"
    keep: Annotated[str, typer.Option(metavar="TIME", help="How long history and sensors are kept.")] = "720h"


@dataclass(frozen=True)
class SensorOptions:
    """When a sensor counts as silent, how often all sensors are compared, and how many sensors are kept."""

    silent_after: Annotated[
        str, typer.Option(metavar="TIME", help="A sensor that sends nothing for this time is silent.")
    ] = "90s"
    compare_every: Annotated[
        str, typer.Option(metavar="TIME", help="Time between comparisons of all sensors.")
    ] = "5s"
    most: Annotated[
        int,
        typer.Option(
            "--max-sensors", help="Largest number of sensors that are kept; further sensors are only counted."
        ),
    ] = 20_000


@dataclass(frozen=True)
class PrintOptions:
    """What is printed to stdout instead of a web page."""

    json: Annotated[
        bool,
        typer.Option("--json", help="Print the fleet as one line of JSON, without a page, and end."),
    ] = False
    every: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="With --json: keep running, and print a line once every TIME."),
    ] = None


@takes_settings([], only=("mqtt.",))
@takes_groups
def fleet(
    settings: dict[str, Any],
    *,
    mqtt: Annotated[
        str | None,
        typer.Option("--mqtt", metavar="BROKER", help="HOST, HOST:PORT, `mqtt://…` or `mqtts://…` (TLS)."),
    ] = None,
    page: PageOptions,
    kept: HistoryOptions,
    sensors: SensorOptions,
    printed: PrintOptions,
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.parquet", help="Write the history of --history as a Parquet file, without a broker."
        ),
    ] = None,
    config: ConfigFile = None,
) -> None:
    """Show all sensors that publish to a broker: the noise of each, and which differ from the others.

    The daemons (`fltea run --mqtt BROKER`) estimate; this command only shows their results. User and password
    for the broker come from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD.

    For example:

        fltea fleet --mqtt broker.example --history fleet.db

        fltea fleet --mqtt mqtts://broker.example --json

        fltea fleet --history fleet.db --export history.parquet
    """
    if export is not None:
        if mqtt is not None or printed.json or printed.every is not None:
            raise UsageError(
                "--export reads a history and asks no broker: leave --mqtt, --json and --every out."
            )
        _export(kept.history, kept.postgres, export)
        return
    plan = _plan(_broker(settings, mqtt, config), kept, sensors)
    every_s = None if printed.every is None else _seconds("--every", printed.every)
    if kept.postgres is not None and kept.history is not None:
        raise UsageError("give --history or --postgres, not both.")
    if every_s is not None and not printed.json:
        raise UsageError("--every needs --json.")
    from fltea.fleet.program import Fleet

    if printed.json:
        _print(Fleet(plan, say), every_s)
        return
    host, port = page.address()
    password = page.password(host)
    _serve(Fleet(plan, say), host, port, page.name or [], password)


def _broker(settings: dict[str, Any], mqtt: str | None, config: Path | None) -> "MqttConfig":
    from fltea.settings.config import load_config

    broker = {} if mqtt is None else {"mqtt.broker": mqtt}
    chosen = load_config(config, settings | broker).mqtt
    if chosen.broker is None:
        raise UsageError("no broker is named: give --mqtt HOST, or broker in the table [mqtt] of --config.")
    return chosen


def _plan(broker: "MqttConfig", kept: HistoryOptions, sensors: SensorOptions) -> "Plan":
    load("paho.mqtt.client", "paho", "fleet", "fltea fleet needs")
    load("tornado.web", "tornado", "fleet", "fltea fleet needs")
    load("prometheus_client", "prometheus_client", "fleet", "fltea fleet needs")
    from fltea.fleet.program import Plan

    if sensors.most < 1:
        raise UsageError("--max-sensors: give 1 or more.")
    return Plan(
        broker,
        kept.history,
        kept.postgres,
        _seconds("--history-every", kept.history_every),
        _seconds("--keep", kept.keep),
        _seconds("--silent-after", sensors.silent_after),
        _seconds("--compare-every", sensors.compare_every),
        sensors.most,
    )


def _serve(running: "Fleet", host: str, port: int, names: list[str], password: str | None) -> None:
    from fltea.fleet.web import serve

    def ready(bound_port: int) -> None:
        running.start()
        shown = f"[{host}]" if ":" in host else host
        say(f"the fleet is at http://{shown}:{bound_port}/")

    def stop(loop: "IOLoop") -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))

    try:
        serve(running, host, port, names, password, ready, stop)
    finally:
        running.close()


def _print(running: "Fleet", every_s: float | None) -> None:
    import msgspec

    def line() -> None:
        running.look_now()
        print(escaped(msgspec.json.encode(running.summary()).decode()), flush=True)

    running.start()
    try:
        if not running.listener.is_up.wait(FIRST_S):
            raise FlteaError(f"no broker answered within {FIRST_S:g} s.")
        _settle(running, SETTLED_S)
        line()
        if every_s is not None:
            signal.signal(signal.SIGTERM, interrupt)
            with contextlib.suppress(KeyboardInterrupt, Interrupted):
                while True:
                    _turn(running, every_s)
                    line()
    except BrokenPipeError:
        silence_stdout()
    finally:
        running.close()


def _turn(running: "Fleet", seconds: float) -> None:
    from fltea.fleet.program import TURN_S

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        running.turn()
        time.sleep(TURN_S)


def _settle(running: "Fleet", quiet_s: float) -> None:
    """Wait until the broker has sent all retained messages and no new sensor has appeared for `quiet_s`."""
    before = -1, False
    while before != (len(running.roll.sensors), True):
        before = len(running.roll.sensors), running.is_complete
        _turn(running, quiet_s)


def _export(history: Path | None, postgres: str | None, out: Path) -> None:
    if postgres is None and history is None:
        raise UsageError(
            "--export: no history is named: give --history FILE, the file of a fleet, or --postgres URL."
        )
    if postgres is None and history is not None:
        _check_history(history)
        check_outputs([("--export", out)], [(history, "the history")])
    load("pyarrow", "pyarrow", "tables", "Parquet files need")
    from fltea.fleet.databases import Postgres, Sqlite
    from fltea.fleet.history import TABLES
    from fltea.fleet.history_table import write

    if out.suffix != ".parquet":
        raise UsageError(f"--export {out}: the table is Parquet; call it NAME.parquet.")
    database = Sqlite(history, TABLES) if postgres is None else Postgres(postgres, (), to_write=False)
    try:
        say(f"{out}: {write(database, out)} rows")
    except OSError as error:
        raise FlteaError(
            f"--export {out}: cannot be written ({error.strerror or error}). Is the folder there, may it be "
            "written to, and is there room on the disk?"
        ) from error


def _check_history(path: Path) -> None:
    """Raise UsageError unless the history to export is a file. As elsewhere, a link is not followed."""
    try:
        mode = path.lstat().st_mode
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"--history {path}: cannot be read ({reason}). Name the file that `fltea fleet --history` keeps."
        ) from error
    if stat.S_ISLNK(mode):
        raise UsageError(f"--history {path}: is a link; name the file that it leads to: {path.resolve()}.")
    if not stat.S_ISREG(mode):
        what = "folder" if stat.S_ISDIR(mode) else "pipe or a device"
        raise UsageError(
            f"--history {path}: is a {what}, and not the file that `fltea fleet --history` keeps."
        )


def _seconds(flag: str, text: str) -> float:
    seconds = duration.in_seconds(text)
    if seconds is None:
        raise UsageError(
            f"{flag} {text}: give a time with its unit ({', '.join(duration.SECONDS)}), such as 30s."
        )
    if seconds <= 0:
        raise UsageError(f"{flag} {text}: has to be longer.")
    return seconds
