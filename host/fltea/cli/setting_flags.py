"""Flags of settings, made from their declarations: a new setting has its flag without a line here."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer
from msgspec import inspect as types

from fltea.settings.config import SETTINGS, of_flags
from fltea.settings.setting import Declared


def takes_settings(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command a flag for each setting that declares one.

    Its parameter `settings` is filled with what these flags say, by the path of the setting. Values are texts
    until the setting's own declaration reads and checks them, so that a wrong one has the same error as in a
    file or with --set.
    """
    own = inspect.signature(command, eval_str=True)
    flags = {
        path.replace(".", "_"): one
        for path, one in SETTINGS.items()
        if one.setting.flags and not path.startswith("accel.")
    }

    @wraps(command)
    def called(**given: Any) -> None:
        texts = {one.path: given.pop(name) for name, one in flags.items()}
        command(settings=of_flags(texts), **given)

    parameters = [one for name, one in own.parameters.items() if name != "settings"]
    parameters += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=_option(one))
        for name, one in flags.items()
    ]
    called.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called


def option(path: str, help: str | None = None) -> Any:
    """Return the flag of a setting, for the signature of another command; help: in place of its meaning."""
    one = SETTINGS[path]
    return typer.Option(*one.setting.flags, metavar=_metavar(one), help=help or _help(one))


def _option(one: Declared) -> Any:
    if isinstance(one.kind, types.BoolType):
        return Annotated[bool | None, typer.Option(*one.setting.flags, help=one.setting.meaning)]
    return Annotated[str | None, option(one.path)]


def _metavar(one: Declared) -> str:
    words = [str(word) for word in one.words]
    return one.setting.metavar or "|".join(words + ["NUMBERS"] * (types.FloatType in map(type, one.kinds)))


def _help(one: Declared) -> str:
    if one.default is None:
        return one.setting.meaning
    unit = f" {one.unit}" if one.unit and not isinstance(one.default, str) else ""
    return f"{one.setting.meaning} (default {one.default}{unit})"
