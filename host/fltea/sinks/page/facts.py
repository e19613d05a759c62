"""Return what the page says in words and numbers, as data that can be sent to the browser as JSON."""

from typing import Any

from fltea.documents import curves as charts
from fltea.documents.chart import Curve, log_log
from fltea.records.plus_minus import NORMAL_95, angle_within
from fltea.records.records import (
    AXES,
    Epoch,
    EstimatorInfo,
    Hello,
    Motion,
    Stats,
    Step,
)
from fltea.records.sensor_kind import kind_of
from fltea.records.units import MOST_DEG
from fltea.records.visible import visible, visible_lines
from fltea.sinks.axis_words import unit_of
from fltea.sinks.changes import sentence as changed
from fltea.sinks.figures.figure import Cells, Seen
from fltea.sinks.figures.table import rows
from fltea.sinks.page import facts_of_device
from fltea.sinks.page.axis_sentence import answer_of, axis_sentence, heading
from fltea.sinks.page.data_sheet import coefficients
from fltea.sinks.page.fits import Curves
from fltea.sinks.page.happenings import EPOCH_WORDS
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.tiers import WINDOWS
from fltea.sinks.words import Level, duration, guard_words

STALL_NS = 1_500_000_000
SHOWN_EVENTS = 12
SHOWN_STEPS = 3
FAR_PPM = 20_000
"""The page shows a warning if the rates of the device's clock and of the computer's clock differ by at least
this [ppm]. No crystal is so inaccurate.
"""


def state(history: DeviceHistory, now_ns: int) -> dict[str, str]:
    """Return the name of a device, its state, and a text that says what is wrong if something is wrong."""
    with history.lock:
        level, text = status(history, now_ns)
    return {"name": history.name, "level": level, "text": "" if level == "good" else text}


def status(history: DeviceHistory, now_ns: int) -> tuple[Level, str]:
    """Return the device's state as a level, such as "good" or "bad", and as one line of text.

    `now_ns`: present monotonic time.
    """
    hello, epoch, heard_ns = history.hello, history.epoch.record, history.heard_ns
    error = history.error
    if heard_ns is None or hello is None or epoch is None:
        if error is not None:
            return "bad", f"waiting for the device: {visible_lines(error.record.message)}"
        return (
            "wait",
            "waiting for the device" if hello is None else "connected, waiting for the first sample",
        )
    silent_ns = now_ns - heard_ns
    if silent_ns > STALL_NS:
        if error is not None and error.heard_ns > heard_ns:
            return "bad", f"stalled for {duration(silent_ns * 1e-9)}: {visible_lines(error.record.message)}"
        if hello.sampling_mode == "recording" or hello.source.startswith("synthetic:"):
            return "wait", f"at its end: no sample for {duration(silent_ns * 1e-9)}"
        return "bad", f"stalled for {duration(silent_ns * 1e-9)}: no sample arrives"
    begun = f"epoch {epoch.epoch}: {EPOCH_WORDS[epoch.reason]}"
    reconnects = history.stats.link.reconnects if history.stats else 0
    if epoch.epoch > 1:
        begun = ("reconnected, " if reconnects else "") + begun
    to_go = _startup_to_go(history, epoch)
    if to_go > 0:
        return "wait", f"start-up: {to_go} samples to go; keep the sensor at rest ({begun})"
    if facts_of_device.silent(history):
        return "wait", f"{facts_of_device.NOTHING_YET} ({begun})"
    lost = [name for name, axis in history.epoch.newest.items() if not axis.fltea.valid]
    if lost:
        return "bad", f"{', '.join(lost)} not valid ({begun})"
    age_ns = history.sample.host_ns - epoch.host_ns if history.sample else 0
    return "good", f"running for {duration(age_ns * 1e-9)} ({begun})"


def _startup_to_go(history: DeviceHistory, epoch: Epoch) -> int:
    """Return the number of samples that the start-up windows still need.

    The windows are those of this computer's estimators and of the device's estimator.
    """
    if epoch.reason == "resumed":
        return 0
    of_host = max((info.startup_samples for info in infos(epoch) if info.estimate_on != "device"), default=0)
    return max(of_host - history.samples_of_epoch, facts_of_device.startup_to_go(history))


def slow(stats: Stats | None) -> str:
    """Return a warning if the rates of the device's clock and of this computer's differ very much."""
    if stats is None or stats.clock_ppm is None or abs(stats.clock_ppm) < FAR_PPM:
        return ""
    share = 1 + stats.clock_ppm * 1e-6
    return (
        f"The device's clock runs at {share:.2f} times this computer's. That of an emulator on a busy "
        "computer does so. Fewer samples a second arrive then, but the figures are not affected."
    )


def now(history: DeviceHistory, now_ns: int) -> dict[str, Any]:
    """Return the state of a device, and a few words for each part of the page.

    The page shows the words of a part while the user has not opened this part.
    """
    level, text = status(history, now_ns)
    sample, newest = history.sample, list(history.happenings)[-1:]
    lost = [f"{label}: {value}" for label, value, of in link(history.stats) if of == "bad"]
    return {
        "status": {"level": level, "text": text},
        "slow": slow(history.stats),
        "seq": sample.seq if sample else None,
        "epoch": history.epoch.record.epoch if history.epoch.record else None,
        "time_ms": sample.host_ns // 1_000_000 if sample else None,
        "fit": fitted(history),
        "settings": settings(history),
        "link": {"level": "bad" if lost else "plain", "text": ", ".join(lost) or "nothing is lost"},
        "happened": visible_lines(newest[0].text) if newest else "nothing yet",
    }


def axes(history: DeviceHistory) -> list[dict[str, Any]]:
    """Return for every axis what is known about it, in one sentence."""
    return [_axis(history, name) for name in history.axes]


def _axis(history: DeviceHistory, name: str) -> dict[str, Any]:
    found = answer_of(history.fits, history.stats, name)
    head, rest = axis_sentence(found, history.fits, history.stats, history.epoch.newest.get(name), name)
    return {
        "name": name,
        "kind": found.kind,
        "head": head,
        "rest": rest,
        "quantity": kind_of(name).quantity,
        "unit": unit_of(name),
    }


def axis(history: DeviceHistory, name: str, window: int) -> dict[str, Any]:
    """Return details of an axis: about its fit, about the filters, and about the device's own estimates.

    `window`: index of the time window that is shown.
    """
    found = answer_of(history.fits, history.stats, name)
    allan = history.fits.curves[name].allan if name in history.fits.curves else None
    stats = history.stats.axes.get(name) if history.stats else None
    return {
        "estimator": history.estimator(name),
        "unit": unit_of(name),
        "text": [part for part in (found.text, found.left_out) if part],
        "changes": changes(history, name),
        "coefficients": coefficients(allan, name in AXES) if allan else [],
        "headings": _headings(history, name),
        "rows": _running(history, name),
        "guard": guard_words(stats.interventions if stats else {}),
        "compared": facts_of_device.compared(history, name, window),
        "of_board": facts_of_device.fit(history, name),
    }


def _running(history: DeviceHistory, name: str) -> list[Cells]:
    """Return rows of text about the filters of an axis that process sample after sample."""
    seen = Seen(history.stats, history.hello, name, history.epoch.newest.get(name))
    return [[label, value] for label, value, *_ in rows("axis", seen)]


def changes(history: DeviceHistory, name: str) -> list[tuple[str, int, str]]:
    """Return the present motion and the newest steps of an axis's bias.

    Each entry consists of the words before the time, the time [ms], and the words after the time.

    The browser formats the time, since it knows the reader's time zone.
    """
    newest: list[Step | Motion] = [] if history.marks.moving is None else [history.marks.moving]
    newest += list(history.marks.steps.get(name, ()))[-SHOWN_STEPS:][::-1]
    found = []
    for one in newest:
        before, _, after = changed(one, "\0").removeprefix(f"{name}: ").partition("\0")
        found.append((visible(before), one.host_ns // 1_000_000, visible(after)))
    return found


def marks(history: DeviceHistory, name: str, window: int) -> dict[str, Any]:
    """Return the steps of an axis's bias, and the motions of the sensor, within a time window.

    The diagrams mark them.
    """
    end_ns = history.sample.host_ns if history.sample else 0
    return history.marks.within(name, end_ns - int(WINDOWS[window].length_s * 1e9), end_ns)


def fitted(history: DeviceHistory) -> str:
    """Return a text that states the number of samples of the newest fit."""
    fit, hello = history.fits.newest, history.hello
    if fit is None:
        return ""
    time = f" ({duration(fit.samples / hello.rate_hz)})" if hello else ""
    return f"fit of {fit.samples:,} samples{time}"


def spectra(history: DeviceHistory) -> dict[str, str]:
    """Return for each axis with a spectrum its small diagram of the spectrum."""
    drawn = history.fits.drawn
    return {name: drawn[name].svg(unit_of(name)) for name in history.axes if name in drawn}


def curves(history: DeviceHistory, name: str) -> list[str]:
    """Return the diagrams of an axis: spectrum, Allan deviation, error of the heading.

    A diagram is left out if its data are unknown.
    """
    fit, found = history.fits.axes.get(name), history.fits.curves.get(name, Curves())
    board, unit, ahead = history.fits.device_spectra.get(name), unit_of(name), heading(history.stats, name)
    shown = []
    if found.spectrum is not None:
        crosses = (board.hz, board.density) if board else ((), ())
        shown.append(charts.spectrum(found.spectrum, unit, fit.rate_left_out if fit else (), crosses))
    if found.allan is not None:
        shown.append(charts.allan(found.allan, unit))
    ahead = {t_s: std for t_s, std in ahead.items() if std <= MOST_DEG}
    if ahead:
        line = Curve([*ahead], [NORMAL_95 * std for std in ahead.values()], "model")
        title = "Heading after the rest so far, 95 %"
        shown.append(log_log(title, "time after the rest [s]", "± of the angle [deg]", [line]))
    return [one for one in shown if one]


def _headings(history: DeviceHistory, name: str) -> list[list[str]]:
    """Return rows of text about the error of the heading after a rest.

    The first row says how long the sensor has rested; each other row gives the 95 % error of the heading
    after some time.
    """
    rows = [[f"after {duration(t)}", angle_within(std)] for t, std in heading(history.stats, name).items()]
    rest_s = history.samples_of_epoch / history.rate_hz
    return [["rest so far", duration(rest_s)], *rows] if rows else []


def infos(epoch: Epoch) -> list[EstimatorInfo]:
    """Return the settings of an epoch's estimators: the gyroscope's, and the accelerometer's."""
    return [info for info in (epoch.estimator, epoch.accel_estimator) if info is not None]


def link(stats: Stats | None) -> list[Cells]:
    """Return rows about the connection to the device.

    Each row has a label, a value, and the level of severity of this value.
    """
    return list(rows("link", Seen(stats))) if stats is not None else []


def device(hello: Hello | None, temperature_c: float | None) -> list[list[str]]:
    """Return rows about the device, most of them from its HELLO. Each row has a label and a value."""
    if hello is None:
        return []
    chip = f"(WHO_AM_I 0x{hello.who_am_i:02x})" if hello.who_am_i is not None else None
    rows: list[tuple[str, str | None]] = [
        ("source", hello.source),
        ("sensor", " ".join(part for part in (hello.sensor, chip) if part)),
        ("firmware", hello.firmware_version),
        ("protocol", hello.protocol),
        ("device id", hello.device_id),
        ("boot id", None if hello.boot_id is None else str(hello.boot_id)),
        ("nominal rate", f"{hello.rate_hz:g} Hz ({hello.sampling_mode.replace('_', ' ')})"),
        ("gyroscope range", _number(hello.gyro_range_dps, "±{:g} deg/s")),
        ("sensitivity", _number(hello.gyro_lsb_per_dps, "{:g} LSB per deg/s")),
        ("low-pass filter", _number(hello.gyro_dlpf_hz, "{:g} Hz")),
        ("accelerometer range", _number(hello.accel_range_g, "±{:g} g")),
        ("temperature", _number(temperature_c, "{:.2f} °C")),
    ]
    return [[label, visible(value)] for label, value in rows if value]


def events(history: DeviceHistory) -> list[dict[str, Any]]:
    """Return the last events as a list, with the newest event first."""
    newest = list(history.happenings)[-SHOWN_EVENTS:][::-1]
    return [
        {"time_ms": h.host_ns // 1_000_000, "kind": h.kind, "text": visible_lines(h.text)} for h in newest
    ]


def settings(history: DeviceHistory) -> str:
    """Return the settings of the epoch's estimator, in one line of text."""
    if history.epoch.record is None:
        return ""
    found = infos(history.epoch.record)
    if not found:
        return ""
    e = found[0]
    window = f"{e.window:,}" if e.window else "unlimited"
    whose = facts_of_device.whose(history, e.estimate_on)
    who = "" if e.estimate_on == "host" else f"estimates on {e.estimate_on}{whose}, "
    return f"variant {e.variant}, guard {e.guard}, {who}memory {e.memory}, L = {window}"


def _number(value: float | None, form: str) -> str | None:
    return None if value is None else form.format(value)
