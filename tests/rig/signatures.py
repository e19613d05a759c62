"""Compare a module's functions with those that a `Protocol` declares."""

import inspect
from types import ModuleType
from typing import get_args, get_type_hints


def lacking(module: ModuleType, declared: type, *names: str) -> list[str]:
    """Return what `module` lacks of the functions `names` of the protocol `declared`, in words.

    A function may return a subclass of what the protocol says.
    """
    found = []
    for name in names:
        function, wanted = getattr(module, name, None), getattr(declared, name)
        if not inspect.isfunction(function):
            found.append(f"{module.__name__} has no function {name}")
            continue
        mine, theirs = get_type_hints(function), get_type_hints(wanted)
        got, expected = mine.pop("return", None), theirs.pop("return")
        fits = got == expected or all(_implements(one, expected) for one in get_args(got) or (got,))
        if list(inspect.signature(function).parameters) != list(inspect.signature(wanted).parameters)[1:]:
            found.append(f"{module.__name__}.{name} has other parameters than {declared.__name__} says")
        elif mine != theirs or not fits:
            found.append(f"{module.__name__}.{name} has other types than {declared.__name__} says")
    return found


def _implements(got: object, expected: object) -> bool:
    """Return whether `got` is a subclass of `expected`, or has the attributes of this protocol."""
    if not (isinstance(got, type) and isinstance(expected, type)):
        return got == expected
    if not getattr(expected, "_is_protocol", False):
        return issubclass(got, expected)
    methods = [name for name, one in vars(expected).items() if inspect.isfunction(one)]
    return all(callable(getattr(got, name, None)) for name in methods)
