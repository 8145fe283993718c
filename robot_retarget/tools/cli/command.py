"""Commands whose options are the fields of dataclasses."""

from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, TypeVar, dataclass_transform, get_type_hints

import typer

TYPER = "typer"
"""Where the metadata of a field keep its option."""
Group = TypeVar("Group", bound=type)


def option(help: str, *names: str, default: Any = MISSING, **more: Any) -> Any:
    """Return a field that is an option; without `default` the user has to give it.

    Args:
        help: its line of `--help`.
        names: its names; by default the field's.
        default: its value where the user gives none.
        more: as of `typer.Option`.
    """
    return field(default=default, metadata={TYPER: typer.Option(*names, help=help, **more)})


def argument(help: str, default: Any = MISSING, **more: Any) -> Any:
    """Return a field that is an argument by its place on the command line; `more` as of `typer.Argument`."""
    return field(default=default, metadata={TYPER: typer.Argument(help=help, **more)})


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option, argument))
def options(group: Group) -> Group:
    """Make a class of fields by `option` and `argument` a group of options."""
    return dataclass(frozen=True, kw_only=True)(group)


def command(
    commands: typer.Typer, name: str | None = None, *, epilog: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function as a command: each parameter that is a group of options gives its fields as options."""

    def registered(function: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(function, include_extras=True)
        groups: dict[str, Any] = {parameter: kind for parameter, kind in hints.items() if is_dataclass(kind)}

        @wraps(function)
        def run(**given: Any) -> None:
            made = {p: kind(**{f.name: given.pop(f.name) for f in fields(kind)}) for p, kind in groups.items()}
            function(**made, **given)

        parameters = signature(function).parameters.values()
        run.__signature__ = Signature([one for each in parameters for one in _expanded(each, hints)])  # pyright: ignore[reportAttributeAccessIssue]
        run.__annotations__ = {}
        commands.command(name, epilog=epilog)(run)
        return function

    return registered


def _expanded(parameter: Parameter, hints: dict[str, Any]) -> Iterator[Parameter]:
    """Yield the options of a group, or a parameter that is an option itself."""
    kind = hints[parameter.name]
    if not is_dataclass(kind):
        yield Parameter(parameter.name, Parameter.KEYWORD_ONLY, default=parameter.default, annotation=kind)
        return
    types = get_type_hints(kind, include_extras=True)
    for each in fields(kind):
        default = Parameter.empty if each.default is MISSING else each.default
        annotation = Annotated[types[each.name], each.metadata[TYPER]]
        yield Parameter(each.name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
