"""Write noise figures with the names and units of navigation filters and simulators (programs.toml)."""

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from textwrap import wrap
from typing import Literal, NamedTuple

import msgspec

from fltea.documents.imu_yaml import AS_MEASURED, WIDTH, Inflation, Shown
from fltea.records.version import __version__

Figure = Literal["N", "K", "sigma", "tau", "B"]
Sensor = Literal["gyro", "accel"]
WALKS = "K", "sigma"
"""Figures that `Inflation.walks` multiplies. N is multiplied by `Inflation.densities`, τ and B by nothing."""


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One parameter in the settings of a program.

    Its value is scale · (figure · √rate)^power. With `per` empty, the rate is 1. With "sample" it is the
    sampling rate, with "step" the number of updates of the program per second.
    """

    name: str
    sensor: Sensor
    figure: Figure
    unit: str
    scale: float = 1.0
    per: Literal["", "sample", "step"] = ""
    power: int = 1
    each: bool = False

    def value(self, figure: float, rate_hz: float, step_s: float | None) -> float:
        """Return the value of the parameter for a figure in rad, m and s.

        `rate_hz`: sampling rate [Hz]. `step_s`: time between two updates of the program [s], for a parameter
        with `per` "step".
        """
        return self.scale * math.pow(figure * math.sqrt(self._rate(rate_hz, step_s)), self.power)

    def figure_of(self, value: float, rate_hz: float, step_s: float | None) -> float:
        """Return the noise figure for a value of the parameter. The method `value` does the opposite."""
        return math.pow(value / self.scale, 1 / self.power) / math.sqrt(self._rate(rate_hz, step_s))

    def _rate(self, rate_hz: float, step_s: float | None) -> float:
        return {"": 1.0, "sample": rate_hz, "step": 1 / (step_s or math.nan)}[self.per]


class Checked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An example from the program's own files: a parameter's value, and the noise figure that it means."""

    name: str
    value: float
    figure: float
    rate_hz: float


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One program for which fltea writes noise settings.

    `line`: template for the text of a parameter. `before`, `after`: lines of text around the parameters.
    """

    title: str
    about: list[str]
    sources: list[str]
    line: str
    entries: list[Entry]
    checked: list[Checked]
    comment: str = "#"
    before: list[str] = []
    after: list[str] = []
    step_s: float | None = None

    def entry(self, name: str) -> Entry:
        """Return the parameter with this name."""
        return next(one for one in self.entries if one.name == name)


@cache
def programs() -> dict[str, Program]:
    """Return all programs by name. The name is what the user gives to --for."""
    text = files("fltea.documents").joinpath("programs.toml").read_text(encoding="utf-8")
    return msgspec.convert(tomllib.loads(text), dict[str, Program])


class FilterFigures(NamedTuple):
    """The figures of one axis for a filter, in the axis's unit (deg/s or m/s²) and s.

    `said`: a remark on all these figures.
    """

    N: Shown
    K: Shown
    tau: Shown
    """Correlation time of the single Gauss–Markov state that some programs have in place of the random walk
    K.
    """
    B: Shown
    said: str = ""

    def of(self, figure: Figure, common_tau_s: float | None) -> Shown:
        """Return a figure of this axis.

        `common_tau_s`: correlation time for all axes, if the program has only one.

        "sigma" is computed from K and the correlation time τ: over times shorter than τ, a Gauss–Markov state
        with σ = K √(τ / 2) behaves as the random walk.
        """
        if figure != "sigma":
            found: Shown = getattr(self, figure)
            return (
                found
                if figure != "tau" or found.value is None
                else found._replace(value=common_tau_s or found.value)
            )
        tau_s = common_tau_s or self.tau.value
        if tau_s is None:
            return self.K
        root = math.sqrt(tau_s / 2)
        value, at_most = (None if one is None else one * root for one in (self.K.value, self.K.at_most))
        return Shown(value, self.K.remark, at_most)


def written(
    program: Program,
    gyro: Mapping[str, FilterFigures],
    accel: Mapping[str, FilterFigures],
    rate_hz: float,
    source: str,
    inflation: Inflation,
) -> str:
    """Return lines of text for a program, ready to paste.

    For a figure that is not known, there is a comment with the reason.

    `gyro`, `accel`: axes by name. `source`: the recording that was identified.
    """
    said = [f"{program.title}: noise at rest by fltea {__version__} from {' '.join(source.split())}"]
    said.append(" ".join(program.about))
    if inflation.reasons:
        said += [f"Inflated: {reason}" for reason in inflation.reasons]
    elif inflation != AS_MEASURED:
        density, walk = inflation.density, inflation.random_walk
        said.append(f"Inflated: densities {density:g} times, walks {walk:g} times what was measured.")
    said += [f"{name}: {one.said}" for name, one in {**gyro, **accel}.items() if one.said]
    lines = [f"{program.comment} {line}" for text in said for line in wrap(text, WIDTH)]
    lines += [_filled(text, rate_hz) for text in program.before]
    tau_s = None
    if any(entry.figure == "tau" and not entry.each for entry in program.entries):
        tau_s = max((one.tau.value or 0.0 for one in (gyro or accel).values()), default=0.0) or None
    for entry in program.entries:
        axes = gyro if entry.sensor == "gyro" else accel
        shown = {name: one.of(entry.figure, tau_s) for name, one in axes.items()}
        lines += _lines(program, entry, shown, rate_hz, inflation)
    lines += [_filled(text, rate_hz) for text in program.after]
    return "\n".join(lines) + "\n"


def _filled(text: str, rate_hz: float) -> str:
    return text.replace("{rate_hz}", f"{rate_hz:.6g}")


def _lines(
    program: Program, entry: Entry, shown: Mapping[str, Shown], rate_hz: float, inflation: Inflation
) -> Iterator[str]:
    """Yield the lines of text for one parameter of a program, or the reason why its value is not known.

    `shown`: the noise figure of each axis from which the value is computed.
    """
    known = {name: one.value for name, one in shown.items() if one.value is not None}
    factors = inflation.walks(shown) if entry.figure in WALKS else dict.fromkeys(shown, 1.0)
    factors = inflation.densities(shown) if entry.figure == "N" else factors
    to_si = math.radians(1.0) if entry.sensor == "gyro" and entry.figure != "tau" else 1.0

    def its(name: str, value: float) -> float:
        return entry.value(factors[name] * to_si * value, rate_hz, program.step_s)

    if not known:
        yield f"{program.comment} {entry.name} [{entry.unit}] is not known: {_why(entry, shown, its)}"
        return
    if entry.each:
        bounds = {name: one.at_most for name, one in shown.items() if name not in known}
        usable = known | {name: one or max(known.values()) for name, one in bounds.items()}
        values = [its(name, usable[name]) for name in _three(list(shown))]
        value, of = f"[{', '.join(f'{one:.6e}' for one in values)}]", ", ".join(_three(list(shown)))
        remarks = _remarks({name: shown[name].remark for name in known})
        for name, bound in bounds.items():
            remarks.append(
                f"{name}: not known, {'largest value of the others' if bound is None else 'at most this'}"
            )
    else:
        name = max(known, key=lambda one: its(one, known[one]))
        value, of, remarks = f"{its(name, known[name]):.6e}", name, [shown[name].remark]
    said = "; ".join(dict.fromkeys(filter(None, [f"{entry.unit}, of {of}", *remarks])))
    yield program.line.format(name=entry.name, value=value, note=f"{program.comment} {said}")


def _remarks(by_axis: Mapping[str, str]) -> list[str]:
    """Return each remark once, as "axes: remark"; the remark alone if all axes have the same one."""
    found: dict[str, list[str]] = {}
    for name, remark in by_axis.items():
        found.setdefault(remark, []).append(name)
    if len(found) == 1:
        return list(found)
    return [f"{', '.join(names)}: {remark}" for remark, names in found.items() if remark]


def _three(names: Sequence[str]) -> list[str]:
    """Return the axes for x, y and z. An axis that was not analysed is replaced by the first that was."""
    found = [next((name for name in names if name.endswith(f"_{axis}")), None) for axis in "xyz"]
    return [name or names[0] for name in found]


def _why(entry: Entry, shown: Mapping[str, Shown], its: Callable[[str, float], float]) -> str:
    if not shown:
        return f"the {'gyroscope' if entry.sensor == 'gyro' else 'accelerometer'} was not analysed"
    reasons = list(filter(None, (one.remark for one in shown.values())))[:1]
    bounds = {name: its(name, one.at_most) for name, one in shown.items() if one.at_most is not None}
    if bounds:
        worst = max(bounds, key=lambda name: bounds[name])
        reasons = [
            *filter(None, [shown[worst].remark]),
            f"{worst}: at most {bounds[worst]:.2e}, with 95 % probability",
        ]
    return "; ".join(reasons) or "no axis shows it"
