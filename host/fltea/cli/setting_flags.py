"""Command-line flags, made from the declarations of settings: a new setting gets its flag automatically."""

import inspect
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from msgspec import inspect as types

from fltea.records.errors import UsageError
from fltea.settings.config import SETTINGS, of_flags, parse_setting
from fltea.settings.how import How
from fltea.settings.setting import Declared
from fltea.settings.sources import help_text

Command = Callable[..., None]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", "-c", metavar="FILE", help="TOML file of settings; flags override it."),
]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        "-s",
        metavar="URL",
        help=f"{help_text()}; repeat it for several devices. Default: the Arduino Due, once it is "
        "plugged in.",
    ),
]
LIMITS = ("replay.max_chunk_mb", "replay.max_mb")
"""Settings that limit the memory that a recording may take."""

FILTERS = ("estimator.variant", "estimator.guard", "estimator.window", "estimator.startup")
RECORDING = tuple(f"replay.{name}" for name in How.__struct_fields__)
"""Settings that describe a recording if its file does not state columns, units or rate."""


def takes_settings(
    paths: Sequence[str] | None = None, *, only: tuple[str, ...] = ("",), of_both: bool = False
) -> Callable[[Command], Command]:
    """Return a decorator that adds the flags of settings, and `--set`, to a command.

    The command's parameter `settings` receives the values by the path of the setting; `--set` overrides the
    flags. Values stay texts until the setting's declaration converts and checks them, so a wrong value gives
    the same error as in a file.

    `paths`: settings whose flags are added; None: all settings that declare a flag. `only`: `--set` accepts
    settings whose path begins with one of these; if it is empty, there is no `--set`. `of_both`: a flag for
    the filters of the gyroscope also applies to the filters of the accelerometer.
    """
    taken = [f"settings of [{start[:-1]}]" if start.endswith(".") else start for start in only]
    flags = {
        path.replace(".", "_"): declared
        for path, declared in SETTINGS.items()
        if (declared.setting.flags and not path.startswith("accel.") if paths is None else path in paths)
    }

    def decorated(command: Command) -> Command:
        @wraps(command)
        def called(*arguments: Any, set_: Sequence[str] | None = None, **given: Any) -> None:
            texts = {declared.path: given.pop(name, None) for name, declared in flags.items()}
            if of_both:
                texts |= {path.replace("estimator.", "accel."): text for path, text in texts.items()}
            settings = of_flags(texts) | dict(map(parse_setting, set_ or ()))
            for path in settings.keys() - texts.keys():
                if not path.startswith(only):
                    raise UsageError(f"--set {path}: this command takes {' and '.join(taken)} only.")
            command(*arguments, settings=settings, **given)

        own = inspect.signature(command, eval_str=True)
        parameters = [one for name, one in own.parameters.items() if name != "settings"]
        annotations = {name: _option(declared) for name, declared in flags.items()}
        annotations |= {"set_": _set(taken)} if only else {}
        parameters += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for name, annotation in annotations.items()
        ]
        called.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        return called

    return decorated


def _set(taken: Sequence[str]) -> Any:
    which = "Takes " + " and ".join(taken) if any(taken) else "Any setting, such as estimator.order.Q0=0.05"
    return Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help=f"{which}; repeatable.")
    ]


def _option(one: Declared) -> Any:
    if isinstance(one.kind, types.BoolType):
        return Annotated[bool | None, typer.Option(*one.setting.flags, help=one.setting.meaning)]
    return Annotated[str | None, typer.Option(*one.setting.flags, metavar=_metavar(one), help=_help(one))]


def _metavar(one: Declared) -> str:
    words = [str(word) for word in one.words]
    return one.setting.metavar or "|".join(words + ["NUMBERS"] * (types.FloatType in map(type, one.kinds)))


def _help(one: Declared) -> str:
    if one.default is None:
        return one.setting.meaning
    unit = f" {one.unit}" if one.unit and not isinstance(one.default, str) else ""
    return f"{one.setting.meaning} (default {one.default}{unit})"
