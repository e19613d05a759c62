"""The command `fltea run`: flags to a configuration."""

from pathlib import Path
from typing import Annotated, Any

import typer

from fltea.cli import how
from fltea.records.errors import UsageError
from fltea.settings import duration, filters
from fltea.settings.config import load_configs, parse_setting
from fltea.wire import layout as wire


def _numbers(text: str | None, flag: str, words: tuple[str, ...]) -> Any:
    """One of `words`, a number, or one number an axis with commas between them."""
    if text is None or text in words:
        return text
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        choices = ", ".join(words)
        raise UsageError(f"{flag} {text}: give {choices}, or numbers with commas between.") from None
    return values if "," in text else values[0]


def _list(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def run(
    source: Annotated[
        list[str] | None,
        typer.Option(
            "--source",
            "-s",
            metavar="URL",
            help="`serial:PORT` (a device path, socket://HOST:PORT, hwgrep://REGEXP), "
            "`i2c:///dev/i2c-1?addr=0x68` (a sensor on a Raspberry Pi), `iio:NAME` (a sensor with a driver "
            "of the Linux kernel), `replay:FILE` (.mcap or a folder of them, .npz, .csv, .ndjson), `stdin:` "
            "or `serial-text:PORT?baud=115200` (lines of CSV or NDJSON, live), `mqtt://BROKER` or "
            "`nats://SERVER` (many devices that publish their frames there) or "
            "`synthetic:?alpha=0.3&f=-1.5`; more than once for several devices. Default: the Arduino Due, "
            "waited for.",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", metavar="FILE", help="TOML file; flags override it.")
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            "--format", help="`ndjson`, `table`, `none`, or `auto`: a table on a terminal, else NDJSON."
        ),
    ] = None,
    once: Annotated[
        bool,
        typer.Option("--once", help="End with the recording; with a device, fail instead of waiting for it."),
    ] = False,
    pace: Annotated[
        str | None,
        typer.Option(
            help="`real` or `fast`, for recordings (default fast) and synthetic noise (default real)."
        ),
    ] = None,
    samples: Annotated[
        bool, typer.Option("--samples", help="Write the samples too, so that the output can be replayed.")
    ] = False,
    every: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Write samples and estimates of every N-th sample only (`seq` a multiple of N), to all "
            "outputs alike; of MQTT's estimate_every and this the larger rules. All samples are estimated, "
            "and events, statistics and the bytes that --record keeps stay whole.",
        ),
    ] = None,
    record: Annotated[
        str | None,  # as a Path, "" would be the folder in which fltea was started
        typer.Option(
            metavar="DIR", help="Record all that comes over the wire, and all records, as MCAP files."
        ),
    ] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="BROKER",
            help="Publish to an MQTT broker: HOST[:PORT], or mqtts://HOST[:PORT] for TLS. User and password "
            "come from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD.",
        ),
    ] = None,
    dashboard: Annotated[
        str | None,
        typer.Option(
            metavar="[HOST:]PORT", help="Serve the live page; without a host for this machine only."
        ),
    ] = None,
    metrics: Annotated[
        str | None,
        typer.Option(metavar="[HOST:]PORT", help="Serve metrics for Prometheus; likewise."),
    ] = None,
    state: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Keep the estimators in FILE, and go on from there after a restart."
        ),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,…",
            help="Axes to estimate: gyro_x, gyro_y, gyro_z (the default), accel_x, accel_y, accel_z.",
        ),
    ] = None,
    columns: how.Columns = None,
    units: how.Units = None,
    rate: how.Rate = None,
    time_column: how.TimeColumn = None,
    time_unit: how.TimeUnitOption = None,
    topic: how.Topic = None,
    shuffle: Annotated[
        int | None,
        typer.Option(metavar="SEED", help="Shuffle a recording: what would white noise of this size give?"),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            "--window",
            "-L",
            metavar="N|TIME",
            help="Length L of the memory in samples, or as a time such as 30s "
            f"(default {filters.WINDOW} samples); 0: unlimited.",
        ),
    ] = None,
    startup: Annotated[
        str | None,
        typer.Option(
            metavar="N|TIME",
            help=f"Start-up window in samples, or as a time such as 5s (default {filters.STARTUP} samples).",
        ),
    ] = None,
    bias: Annotated[
        str | None,
        typer.Option(help="`startup` (mean of the window, default), `none`, or deg/s: 0.1,0,-0.2."),
    ] = None,
    r: Annotated[
        str | None,
        typer.Option(
            "--r", help="Measurement variance R in (deg/s)²: `auto` (of the window, default) or numbers."
        ),
    ] = None,
    estimate_on: Annotated[
        str | None,
        typer.Option(
            help="Who estimates the gyroscope: `host` (this computer, default), `device` (an Arduino Due by "
            "itself, nothing is estimated here) or `both` (with the difference)."
        ),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            help="Memory of past states: `compressed` (default; any window at one cost) or `direct` (exact)."
        ),
    ] = None,
    variant: Annotated[
        str | None, typer.Option(help="`triple` (the paper's) or `joint` (one filter on α and h^α f).")
    ] = None,
    guard: Annotated[
        str | None, typer.Option(help="`off` (the printed algorithm), `faithful` or `consistent`.")
    ] = None,
    tuning: Annotated[
        str | None,
        typer.Option(
            help="Who sets the filters' Q and R while they run: `live` (the live fit, as soon as it knows "
            "them) or `startup` (nobody: the paper's way). By default `live`; `startup` where "
            "Q or R is given, and with --guard off."
        ),
    ] = None,
    baud: Annotated[int | None, typer.Option(help=f"Serial speed (default {wire.BAUD}).")] = None,
    max_gap: Annotated[
        str | None,
        typer.Option(
            metavar="N|TIME",
            help="Longest gap that is bridged, in samples or as a time such as 1s "
            f"(default {filters.MAX_GAP} samples).",
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Any setting, e.g. --set estimator.order.Q0=0.05."),
    ] = None,
) -> None:
    """Estimate state, order α and parameter f of each gyroscope axis, sample by sample.

    Writes one JSON object a line (host/docs/reference/records.md documents the records), or draws a live
    table on a terminal. A device that is missing or falls silent is reported and waited for.

    For example:

        fltea run

        fltea run -s replay:rest.npz --once --format table

        fltea run -s rest.csv --columns gx,gy,gz --units rad/s --rate 100

        my-imu | fltea run -s stdin: --columns gx,gy,gz --time-column t_ms --once

        fltea run -s replay:rest.npz --once --shuffle 1

        fltea run --estimate-on both

        fltea run --dashboard 5006 --record recordings --mqtt mqtts://broker.example --format none

        fltea run -s serial:/dev/ttyACM0 -s 'i2c:///dev/i2c-1?addr=0x68' --channels gyro_z,accel_x
    """
    from fltea.service import daemon

    flags = {
        "format": format,
        "once": once or None,
        "pace": pace,
        "samples": samples or None,
        "output.every": every,
        "record.folder": record,
        "mqtt.broker": mqtt,
        "dashboard.address": dashboard,
        "metrics.address": metrics,
        "state.file": state,
        "channels": _list(channels),
        "replay.columns": _list(columns),
        "replay.units": units,
        "replay.rate_hz": rate,
        "replay.time_column": time_column,
        "replay.time_unit": time_unit,
        "replay.topic": topic,
        "replay.shuffle": shuffle,
        "estimator.window": duration.parse(window),
        "estimator.startup": duration.parse(startup),
        "estimator.bias": _numbers(bias, "--bias", ("startup", "none")),
        "estimator.R": _numbers(r, "--r", ("auto",)),
        "estimator.estimate_on": estimate_on,
        "estimator.memory": memory,
        "estimator.variant": variant,
        "estimator.guard": guard,
        "estimator.tuning": tuning,
        "link.baud": baud,
        "link.max_gap": duration.parse(max_gap),
    }
    overrides = {path: value for path, value in flags.items() if value is not None}
    overrides.update(parse_setting(text) for text in set_ or [])
    daemon.run(load_configs(config, overrides, source or ()))
