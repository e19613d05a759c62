"""The options of `fltea identify`, in groups, and what their texts mean."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fltea.cli import exports
from fltea.cli.option_groups import flags_in_use
from fltea.cli.output import AsJson
from fltea.cli.setting_flags import ConfigFile
from fltea.identification.dask_address import check_address
from fltea.recording.formats import ENDINGS
from fltea.records.errors import UsageError

if TYPE_CHECKING:
    from fltea.identification.axis import IdentifyOptions
    from fltea.identification.forecast import Asked

Recordings = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE…",
        help=f"Recordings: {ENDINGS}, a folder, or the name of a session. With --out also URLs and "
        "patterns: 's3://lab/**/*.mcap'.",
        show_default=False,
    ),
]

Table = Annotated[
    Path | None,
    typer.Option(
        metavar="NAME.parquet",
        help="For many files: write one row per axis to this table, and skip files that are in it "
        "(host/docs/guide/cluster.md).",
    ),
]


@dataclass(frozen=True)
class ShownOptions:
    """How results are shown, and the file of settings."""

    as_json: AsJson = False
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write report.html with all results and charts, and each chart as SVG, to this folder.",
        ),
    ] = None
    config: ConfigFile = None
    details: Annotated[bool, typer.Option("--details", help="Show all figures in a table.")] = False

    @property
    def needs_details(self) -> bool:
        """Whether the output shows more than the short answer for each axis."""
        return self.as_json or self.details or self.report is not None


@dataclass(frozen=True)
class QuestionOptions:
    """Further questions about each axis, such as a forecast, and the frequencies that are used."""

    forecast: Annotated[
        bool,
        typer.Option(
            "--forecast",
            help="Forecast the heading error over time from the first half, and check it on the second half.",
        ),
    ] = False
    rest_for: Annotated[
        str | None,
        typer.Option(
            metavar="DEG@S",
            help="How long to rest so that the heading is good to ± DEG (95 %) after S seconds, such as "
            "0.5@60. Includes --forecast.",
        ),
    ] = None
    drive_for: Annotated[
        str | None,
        typer.Option(
            metavar="DEG@S",
            help="For how many seconds the heading is good to ± DEG (95 %) after a rest of S seconds, such "
            "as 1@30: the inverse of --rest-for. Includes --forecast.",
        ),
    ] = None
    sheet: Annotated[
        str | None,
        typer.Option(
            metavar="PART|DENSITY",
            help="Compare the noise with the data sheet of this gyroscope, such as MPU-9250, or with a rate "
            "noise density in dps/√Hz, such as 0.007. A figure in deg/√h, such as 0.3deg/√h, is an angle "
            "random walk N, of which √2 N is the density.",
        ),
    ] = None
    shuffles: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="With --json, --details or --report: number of shuffled copies on which FLTEA is run, to "
            "show what it gives for white noise of the same power; 0: none, and faster.",
        ),
    ] = 200
    notch: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HZ±HZ|LO-HI",
            help="Leave out a band of frequencies, such as 31.4±0.5 or 30.9-31.9; repeatable.",
        ),
    ] = None
    from_hz: Annotated[
        float, typer.Option("--from-hz", metavar="HZ", help="Leave out all lower frequencies, such as drift.")
    ] = 0.0

    @property
    def flags(self) -> list[str]:
        """The flags that the user has given and that ask for figures of single axes."""
        return flags_in_use(self, "sheet", "forecast", "rest_for", "drive_for")

    def part(self) -> str | None:
        """Return the gyroscope's name or the noise density that the user gave with --sheet, or None.

        Raises:
            UsageError: no data sheet of this gyroscope is known, or no gyroscope has this density.
        """
        if self.sheet is None:
            return None
        from fltea.identification.data_sheet import sheet_name

        return sheet_name(self.sheet)

    def asked(self) -> "Asked":
        """Return whether a forecast is wanted, and which questions it has to answer.

        Raises:
            UsageError: the text of an option is not DEG@SECONDS.
        """
        from fltea.identification.forecast import asked_by

        return asked_by(self.forecast, self.rest_for, self.drive_for)

    def of_each_axis(self) -> "IdentifyOptions":
        """Return the settings with which each axis is identified.

        Raises:
            UsageError: a number or a band of frequencies cannot be used.
        """
        from fltea.identification.axis import IdentifyOptions

        bands = tuple(parse_notch(text) for text in self.notch or [])
        try:
            return IdentifyOptions(shuffles=self.shuffles, from_hz=self.from_hz, notch_hz=bands)
        except ValueError as error:
            raise UsageError(f"command line: {error}.") from error


@dataclass(frozen=True)
class ExportOptions:
    """The files and settings that are written for other programs."""

    export_model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the noise model of one recording, for `fltea simulate --model`. Replaces an existing "
            "file, but never a recording; so do the other files that identify writes.",
        ),
    ] = None
    imu_yaml: Annotated[
        Path | None,
        typer.Option(
            "--imu-yaml",
            metavar="FILE",
            help="Write imu.yaml for Kalibr, of both sensors unless --channels names axes. Replaces an "
            "existing file.",
        ),
    ] = None
    inflate: Annotated[
        str | None,
        typer.Option(
            metavar="X|X,Y|auto",
            help="--imu-yaml and --for: multiply noise densities by X, and random walks by Y (else X). 5 to "
            "20 is common, for errors that only motion shows. auto: compute the factors of each axis such "
            "that the forecast of the recording's first half holds in the second; includes --forecast.",
        ),
    ] = None
    for_program: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="NAME[@S]",
            help="Print only the noise settings of a program, in its own names and units: "
            "kalibr, openvins, vins-fusion, okvis2, kf-gins, gtsam, robot_localization, px4, ardupilot, "
            "matlab-imusensor or gnss-ins-sim. If its settings cannot express some of the noise, they do not "
            "underestimate the heading's error over S seconds (60).",
        ),
    ] = None
    gauss_markov: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the noise parameters of a navigation filter as JSON: σ, τ, N, K, Q and drift, and "
            "`filter`, the matrices of a plain Kalman filter. Replaces an existing file.",
        ),
    ] = None
    allan_csv: Annotated[
        Path | None,
        typer.Option(
            "--allan-csv",
            metavar="FILE",
            help="Write the Allan deviations with their 95 % intervals, and those of the model, as CSV. "
            "Replaces an existing file.",
        ),
    ] = None

    @property
    def has_both_sensors(self) -> bool:
        """Whether the user asks for an export that also describes the accelerometer.

        The accelerometer is read only for such exports, since three more axes double the time.
        """
        return self.imu_yaml is not None or self.for_program is not None

    def program(self) -> tuple[str, float | None] | None:
        """Return the program whose settings the user asks for, and the time [s] given with it, or None.

        Raises:
            UsageError: there is no such program, or the time is not valid.
        """
        return None if self.for_program is None else exports.parse_program(self.for_program)

    def files(self) -> exports.Files:
        """Return the paths of the files to write for other programs, and the factors of --inflate.

        Raises:
            UsageError: the factors of --inflate are no numbers or below 1, or --inflate is given without
                --imu-yaml and without --for.
        """
        inflation = exports.parse_inflation(self.inflate, self.imu_yaml or self.for_program)
        return exports.Files(self.export_model, self.imu_yaml, self.gauss_markov, self.allan_csv, inflation)


@dataclass(frozen=True)
class WorkerOptions:
    """Which processes do the work: on this machine, or in a Dask cluster."""

    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", min=1, help="Number of processes; default: all cores."),
    ] = None
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Use an existing Dask cluster instead: tcp://HOST:8786 or tls://HOST:8786.",
        ),
    ] = None

    def check(self) -> None:
        """Refuse options that exclude each other, and an address that cannot be used.

        Raises:
            UsageError: both options are given, or the address is not valid.
        """
        if self.dask is None:
            return
        if self.jobs is not None:
            raise UsageError("--jobs is for this machine, --dask for a cluster: give one of them.")
        check_address(self.dask)


def parse_notch(text: str) -> tuple[float, float]:
    """Return the ends of a band such as `31.4±0.5`, `31.4+-0.5` or `30.9-31.9` [Hz].

    Raises:
        UsageError: the text is no band.
    """
    number = r"\s*(\d+\.?\d*|\.\d+)\s*"
    around = re.fullmatch(rf"{number}(?:±|\+-|\+/-){number}", text)
    between = re.fullmatch(rf"{number}(?:-|–|…|\.\.){number}", text)
    if around:
        middle, half = map(float, around.groups())
        low, high = max(middle - half, 0.0), middle + half
    elif between:
        low, high = map(float, between.groups())
    else:
        raise UsageError(f"--notch {text}: give a band in Hz, such as 31.4±0.5 or 30.9-31.9.")
    if not low < high:
        raise UsageError(f"--notch {text}: has no width; give a band in Hz, such as 31.4±0.5 or 30.9-31.9.")
    return low, high
