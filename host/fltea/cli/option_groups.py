"""Options of a command that belong together, declared once as the fields of a dataclass.

A command takes such a class as one parameter, and `takes_groups` gives it an option for each field.
"""

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, get_args, get_type_hints

from typer.models import OptionInfo

Command = Callable[..., None]


def takes_groups(command: Command) -> Command:
    """Return the command in which each group of options is replaced by its fields, in the same order.

    A parameter whose type is a dataclass is a group. A field is declared like a parameter of a command:
    `Annotated[type, typer.Option(…)]` and a default.
    """
    own = inspect.signature(command, eval_str=True)
    groups: dict[str, type[Any]] = {
        name: one.annotation
        for name, one in own.parameters.items()
        if isinstance(one.annotation, type) and is_dataclass(one.annotation)
    }

    @wraps(command)
    def called(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    parameters: list[inspect.Parameter] = []
    for name, one in own.parameters.items():
        options = inspect.signature(groups[name]).parameters.values() if name in groups else (one,)
        parameters += [option.replace(kind=inspect.Parameter.KEYWORD_ONLY) for option in options]
    called.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called


def flags_in_use(group: Any, *names: str) -> list[str]:
    """Return the flags of the options in `names` that the user has given, in the order of `names`.

    `group`: the group that holds the options.

    An option whose value is false, such as None or 0, counts as not given.
    """
    hints = get_type_hints(type(group), include_extras=True)
    return [_flag(name, hints[name]) for name in names if getattr(group, name)]


def _flag(name: str, annotation: Any) -> str:
    option = next(one for one in get_args(annotation) if isinstance(one, OptionInfo))
    # Typer stores the first name of an annotated option in its attribute `default`. So the option's true
    # default is not there.
    names = (option.default, *(option.param_decls or ()))
    return next((text for text in names if isinstance(text, str)), "--" + name.replace("_", "-"))
