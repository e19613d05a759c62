"""The files that `fltea identify` writes for other programs: models, imu.yaml, Allan deviations and others.

No file is written for a recording that is marked bad, since the programs that read it would not see the mark.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from fltea.cli.output import say
from fltea.records.errors import FlteaError, UsageError
from fltea.records.records import AXES
from fltea.records.whole_file import check_outputs

if TYPE_CHECKING:
    from fltea.documents.imu_yaml import Inflation
    from fltea.identification.axis_report import AxisReport, FileReport

Inflate = tuple[float, float] | Literal["auto"]
"""Two factors: the first multiplies noise densities, the second random walks. "auto": both factors are
computed from the recording.
"""


class Files(NamedTuple):
    """Paths of the files that the user asks for. None means that a file is not asked for.

    `inflation`: factors by which noise figures are multiplied in imu.yaml and in the settings of other
    programs.
    """

    model: Path | None
    yaml: Path | None
    navigation: Path | None
    allan: Path | None
    inflation: Inflate

    @property
    def asked(self) -> dict[str, Path]:
        """The files that the user asks for, by their flags."""
        named = {
            "--export-model": self.model,
            "--imu-yaml": self.yaml,
            "--gauss-markov": self.navigation,
            "--allan-csv": self.allan,
        }
        return {flag: path for flag, path in named.items() if path is not None}

    @property
    def flags(self) -> list[str]:
        """The flags with which the user asks for files."""
        return list(self.asked)

    def check(self, recordings: Iterable[str | Path], config: Path | None) -> None:
        """Check that no file would replace one of the recordings, the configuration or another file.

        Raises:
            UsageError: one would.
        """
        from fltea.recording.bag_files import files_of

        paths = [Path(one) for one in recordings]
        paths += [file for folder in paths if folder.is_dir() for file in files_of(folder)]
        inputs = [(one, "the recording") for one in paths]
        check_outputs(self.asked.items(), [*inputs, *([(config, "the configuration")] if config else [])])


def parse_inflation(text: str | None, wanted: object) -> Inflate:
    """Return the factors for noise densities and for random walks from a text such as `10` or `5,10`.

    `text`: what the user wrote after --inflate. None gives the factors 1; `auto` is returned unchanged.
    `wanted`: the file or the program for which the user gives the factors; None if the user asks for neither.

    Raises:
        UsageError: the factors are no numbers or below 1, or no file is asked for to which they apply.
    """
    if text is None:
        return 1.0, 1.0
    if wanted is None:
        raise UsageError("--inflate is for --imu-yaml and --for: give one of them.")
    if text == "auto":
        return "auto"
    first, comma, second = text.partition(",")
    try:
        density, walk = float(first), float(second if comma else first)
    except ValueError:
        density = walk = 0.0
    if not (1 <= density < math.inf and 1 <= walk < math.inf):
        raise UsageError(
            f"--inflate {text}: give one factor, 1 or more, such as 10, or two, such as 5,10; or auto."
        )
    return density, walk


def parse_program(text: str) -> tuple[str, float | None]:
    """Return the program and the time [s] in a text such as `px4` or `px4@300`; the time is None if missing.

    Raises:
        UsageError: there is no such program, or the time is not valid.
    """
    from fltea.documents.programs import programs

    name, at, time = text.partition("@")
    known = programs()
    if name not in known:
        near = get_close_matches(name.lower(), known, 1, 0.4)
        meant = f" Is {near[0]} meant?" if near else ""
        raise UsageError(f"--for {text}: no such program; there are {', '.join(known)}.{meant}")
    if not at:
        return name, None
    try:
        seconds = float(time.removesuffix("s"))
    except ValueError:
        seconds = 0.0
    if not 0.1 <= seconds <= 1e6:
        raise UsageError(
            f"--for {text}: give the time up to which the heading's error must not be underestimated, 0.1 to "
            f"1,000,000 s: {name}@300."
        )
    return name, seconds


def _inflation(inflate: Inflate, axes: "Mapping[str, AxisReport]", up_to_s: float) -> "Inflation":
    from fltea.documents.imu_yaml import Inflation
    from fltea.identification.inflation import own_inflation

    return own_inflation(axes, up_to_s) if inflate == "auto" else Inflation(*inflate)


def lines_for(report: "FileReport", program: str, up_to_s: float | None, inflate: Inflate) -> str:
    """Return the lines of settings with which another program takes a recording's noise.

    `program`: name of the program.
    `up_to_s`: time up to which the heading's error must not be underestimated [s]; None: the default.

    Raises:
        FlteaError: no axis was identified, or the data are bad.
        UsageError: the recording is too short to compute the factors that `--inflate auto` asks for.
    """
    from fltea.documents.programs import programs, written
    from fltea.identification.axis_report import AxisReport
    from fltea.identification.filter_figures import UP_TO_S, filter_figures
    from fltea.identification.model_file import by_sensor

    axes = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    if report.recording is None or not axes:
        raise report.failure or FlteaError("--for: no axis was identified.")
    for error in withheld(report, [f"--for {program}"], []):
        raise error
    inflation = _inflation(inflate, axes, up_to_s or UP_TO_S)
    figures = {name: filter_figures(axis, up_to_s or UP_TO_S) for name, axis in axes.items()}
    gyro, accel = by_sensor(figures)
    rate_hz = report.recording.hello.rate_hz
    return written(programs()[program], gyro, accel, rate_hz, report.name, inflation)


def withheld(report: "FileReport", flags: Sequence[str], of_axes: Sequence[str]) -> Iterator[FlteaError]:
    """Yield an error if any of the output that the user asks for is withheld because the data are bad.

    `flags`: the user's flags that ask for one file about all axes.
    `of_axes`: the user's flags that ask for figures of each axis. Axes with good data still get these.
    """
    from fltea.identification.axis_report import AxisReport
    from fltea.identification.findings import data_checks

    good = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    rest = [name for name, axis in good.items() if not axis.withheld]
    if len(rest) == len(good) or not (flags or of_axes):
        return
    bad = [(where, data_check) for where, data_check in data_checks(report) if data_check.severity == "bad"]
    reasons = " ".join(
        f"{where and f'{where}: '}{data_check.text} {data_check.remedy}" for where, data_check in bad
    )
    gyro = [name for name in rest if name in AXES]
    # A model file can hold gyro_y only if it also holds gyro_x, and gyro_z only if it also holds both.
    possible = rest and flags and ("--export-model" not in flags or gyro == list(AXES[: len(gyro)]))
    others = f" The data of the other axes are good: --channels {','.join(rest)}." if possible else ""
    what = ", ".join((*flags, *of_axes))
    yield FlteaError(
        f"{report.name}: the data are bad, so the output of {what} is withheld. {reasons}{others}"
    )


def write(report: "FileReport", files: Files) -> None:
    """Write the files of one recording, unless it could not be read or is marked bad (see `withheld`).

    Raises:
        FlteaError: a file cannot be written, or the fit lacks what the file needs.
        UsageError: the recording is too short to compute the factors that `--inflate auto` asks for.
    """
    from fltea.documents.imu_yaml import imu_yaml
    from fltea.identification import allan_file, model_file, navigation_file
    from fltea.identification.axis_report import AxisReport
    from fltea.identification.filter_figures import UP_TO_S
    from fltea.identification.kalibr import axis_noise

    axes = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    if report.recording is None or not files.flags or any(axis.withheld for axis in axes.values()):
        return
    rate_hz = report.recording.hello.rate_hz
    if files.model is not None:
        try:
            of_axes = model_file.by_sensor({name: axis.model for name, axis in axes.items()})
            models = model_file.NoiseModels(rate_hz, 1 / rate_hz, report.name, *of_axes)
        except ValueError as error:
            raise FlteaError(f"--export-model: {error}.") from error
        model_file.write_json(files.model, models)
    if files.yaml is not None:
        if not axes:
            raise FlteaError("--imu-yaml: no axis was identified.")
        inflation = _inflation(files.inflation, axes, UP_TO_S)
        for reason in inflation.reasons:
            say(f"fltea: inflated {reason}")
        noises = {name: axis_noise(axis) for name, axis in axes.items()}
        gyro, accel = model_file.by_sensor(noises)
        text = imu_yaml(
            gyro,
            rate_hz,
            report.name,
            accel=accel,
            rostopic=report.recording.topic or "/imu0",
            inflation=inflation,
        )
        model_file.write_text(files.yaml, text)
    if files.navigation is not None:
        if not axes:
            raise FlteaError("--gauss-markov: no axis was identified.")
        navigation_file.write_navigation(files.navigation, axes, rate_hz, report.name)
    if files.allan is not None:
        curves = {name: (axis.unit, axis.allan) for name, axis in axes.items() if axis.allan is not None}
        try:
            allan_file.write_allan(files.allan, curves)
        except ValueError as error:
            raise FlteaError(f"--allan-csv: {error}.") from error
