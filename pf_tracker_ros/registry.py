"""Parts that are chosen by name, each registered where it is written."""

from __future__ import annotations

import importlib
import logging
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")
Registered = TypeVar("Registered", bound=Callable[..., Any])


@dataclass(frozen=True)
class NoParameters:
    """The group of a part that has no tunables."""


class Registry(Mapping[str, Callable[..., Part]], Generic[Part]):
    """Name to what makes a part: a class or a function.

    Parts are in the order in which they registered. Other packages bring parts by entry points:
    `NAME = "MODULE:MAKER"`, where the module registers the maker by that name. Their names come
    last, in alphabetical order, and are known without importing anything; each is imported when it
    is asked for. A part that cannot be used is reported in the log, and raises `ParameterError`
    only when it is made.

    Args:
        kind: What the parts are, for messages.
        parameters: The group of tunables that those of every part are derived from.
        group: Of the entry points.
        prefix: How the names of a part's tunables begin in the group around them; empty where parts
            share those that they declare alike.
    """

    def __init__(
        self,
        kind: str,
        parameters: type = NoParameters,
        *,
        group: str = "",
        prefix: str = "{part}.",
    ) -> None:
        self._kind = kind
        self._common = parameters
        self._group = group
        self.prefix = prefix
        self._makers: dict[str, Callable[..., Part]] = {}
        self._parameters: dict[str, type] = {}
        self._loaded: set[str] = set()
        self._unusable: dict[str, str] = {}

    def register(
        self, name: str, parameters: type | None = None
    ) -> Callable[[Registered], Registered]:
        """Decorate a class, or a function, that makes a part.

        Args:
            name: That it is chosen by.
            parameters: Its group of tunables; by default, those that every part has.

        Raises:
            ValueError: The name is taken.
            TypeError: The group lacks what every part has.
        """
        if name in self._makers:
            raise ValueError(f"there is a {self._kind} '{name}' already; choose another name")
        own = parameters or self._common
        if self._common is not NoParameters and not issubclass(own, self._common):
            raise TypeError(
                f"the parameters of the {self._kind} '{name}' have to be derived from "
                f"{self._common.__name__}"
            )

        def enter(maker: Registered) -> Registered:
            self._makers[name] = maker
            self._parameters[name] = own
            return maker

        return enter

    def parameters_of(self, name: str) -> type:
        """The group of tunables of a part."""
        self._load(name)
        return self._parameters[name]

    def check(self, name: str) -> None:
        """Refuse a part of another package that cannot be used.

        Raises:
            ParameterError: Says why, and of which package it is.
        """
        # What declares parameters knows of registries.
        from pf_tracker_ros.parameters import ParameterError

        self._load(name)
        if name in self._unusable:
            raise ParameterError(self._unusable[name])

    def make(self, name: str, parameters: Any) -> Part:
        """A part that is made of nothing but its group of tunables, or of nothing if it has none.

        Raises:
            ParameterError: As `check`.
        """
        maker = self[name]
        return maker() if isinstance(parameters, NoParameters) else maker(parameters)

    def __getitem__(self, name: str) -> Callable[..., Part]:
        self._load(name)
        return self._makers[name]

    def __iter__(self) -> Iterator[str]:
        yield from (name for name in tuple(self._makers) if name not in self._brought)
        yield from self._brought

    def __len__(self) -> int:
        return sum(1 for _ in self)

    @cached_property
    def _brought(self) -> Mapping[str, Sequence[EntryPoint]]:
        """Name to the entry points of other packages; more than one is too many."""
        # It takes as long as the rest of the library, and only lists of parts need it.
        from importlib.metadata import entry_points

        brought: dict[str, list[EntryPoint]] = {}
        found = sorted(entry_points(group=self._group), key=lambda point: (point.name, point.value))
        for point in found if self._group else ():
            maker = self._makers.get(point.name)
            if maker is None or _top_package(maker.__module__) == _top_package(point.value):
                brought.setdefault(point.name, []).append(point)
            else:
                self._report([point], f"there is a {self._kind} of that name already")
        return brought

    def _load(self, name: str) -> None:
        """Import a part that another package brings, unless that was done before."""
        if name in self._loaded or name not in self._brought:
            return
        self._loaded.add(name)
        points = self._brought[name]
        try:
            if len(points) > 1:
                raise ImportError("only one package may bring it; uninstall the others")
            maker = points[0].load()
            if self._makers.get(name) is not maker:
                raise ImportError(
                    f"it is not registered by that name; decorate it by .register('{name}')"
                )
            self._check_parameters(name)
        except Exception as error:
            # Whatever goes wrong in another package, a tracker without its part is to run.
            self._unusable[name] = self._report(points, _in_one_line(error))
            self._makers[name] = partial(self._refuse, name)
            self._parameters[name] = self._common

    def _refuse(self, name: str, *arguments: Any, **keywords: Any) -> Any:
        """Make no part, and say why."""
        self.check(name)

    def _check_parameters(self, name: str) -> None:
        """Refuse tunables that cannot stand beside those of the other parts.

        Raises:
            TypeError: What is wrong with them, and what would be right.
        """
        from pf_tracker_ros.parameters import declarations

        own = declarations(self._parameters[name])
        for other in () if self.prefix else self._makers:
            for declared, theirs in declarations(self._parameters[other]).items():
                if own.get(declared, theirs) != theirs:
                    raise TypeError(
                        f"its parameter '{declared}' is declared otherwise than that of '{other}'; "
                        "declare it alike, or give it a name of its own"
                    )

    def _report(self, points: Sequence[EntryPoint], reason: str) -> str:
        """Log that a part cannot be used; returns what it says."""
        where = " and ".join(
            f"{point.dist.name if point.dist else 'unknown'} ({point.value})" for point in points
        )
        message = f"the {self._kind} '{points[0].name}' of {where} cannot be used: {reason}"
        logging.getLogger(__name__).warning(message)
        return message


def _top_package(name: str) -> str:
    return name.partition(":")[0].partition(".")[0]


def _in_one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def import_all(package: str, path: list[str]) -> None:
    """Import every module of a package, so that what is in them registers itself.

    Args:
        package: Its name.
        path: Its `__path__`.
    """
    for module in sorted(found.name for found in pkgutil.iter_modules(path)):
        importlib.import_module(f"{package}.{module}")
