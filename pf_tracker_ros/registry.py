"""Registries: parts selected by name, each registered in its own module."""

from __future__ import annotations

import importlib
import logging
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pf_tracker_ros.foreign_code import ForeignError, foreign_code

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")
Registered = TypeVar("Registered", bound=Callable[..., Any])


@dataclass(frozen=True)
class NoParameters:
    """The group of a part that has no tunables."""


class Registry(Mapping[str, Callable[..., Part]], Generic[Part]):
    """Mapping of names to factories of parts, which are classes or functions.

    Parts are in order of registration. Other packages add parts by entry points
    `NAME = "MODULE:FACTORY"`, whose module registers the factory by that name. Their names come
    last, in alphabetical order, and are known without an import; a part is imported on first
    access. A part that cannot be imported is logged, and raises `ParameterError` when made.

    Args:
        kind: Kind of the parts, for messages.
        parameters: Base class of the parts' groups of tunables.
        group: Group of the entry points.
        prefix: Prefix of the names of a part's tunables in the enclosing group. If empty, parts
            share tunables of the same name.
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
        self._factories: dict[str, Callable[..., Part]] = {}
        self._parameters: dict[str, type] = {}
        self._loaded: set[str] = set()
        self._unusable: dict[str, str] = {}

    def register(
        self, name: str, parameters: type | None = None
    ) -> Callable[[Registered], Registered]:
        """Decorate the factory of a part.

        Args:
            name: Name of the part.
            parameters: Its group of tunables; by default the registry's base class.

        Raises:
            ValueError: The name is taken.
            TypeError: The group is not derived from the base class.
        """
        if name in self._factories:
            raise ValueError(f"there is a {self._kind} '{name}' already; choose another name")
        own = parameters or self._common
        if self._common is not NoParameters and not issubclass(own, self._common):
            raise TypeError(
                f"the parameters of the {self._kind} '{name}' must be derived from "
                f"{self._common.__name__}"
            )

        def enter(factory: Registered) -> Registered:
            self._factories[name] = factory
            self._parameters[name] = own
            return factory

        return enter

    def parameters_of(self, name: str) -> type:
        """The group of tunables of a part."""
        self._load(name)
        return self._parameters[name]

    def check(self, name: str) -> None:
        """Check that a part can be used.

        Raises:
            ParameterError: It cannot; the message has the reason and its package.
        """
        # Imported here: `parameters` imports this module.
        from pf_tracker_ros.parameters import ParameterError

        self._load(name)
        if name in self._unusable:
            raise ParameterError(self._unusable[name])

    def make(self, name: str, parameters: Any) -> Part:
        """Make a part from its group of tunables, or without arguments if it has none.

        Raises:
            ParameterError: As for `check`.
        """
        factory = self[name]
        return factory() if isinstance(parameters, NoParameters) else factory(parameters)

    def __getitem__(self, name: str) -> Callable[..., Part]:
        self._load(name)
        return self._factories[name]

    def __iter__(self) -> Iterator[str]:
        yield from (name for name in tuple(self._factories) if name not in self._entry_points)
        yield from self._entry_points

    def __len__(self) -> int:
        return sum(1 for _ in self)

    @cached_property
    def _entry_points(self) -> Mapping[str, Sequence[EntryPoint]]:
        """Name to the entry points of other packages; more than one is an error."""
        by_name: dict[str, list[EntryPoint]] = {}
        found = _installed_entry_points().select(group=self._group) if self._group else ()
        for point in sorted(found, key=lambda point: (point.name, point.value)):
            factory = self._factories.get(point.name)
            if factory is None or _top_package(factory.__module__) == _top_package(point.value):
                by_name.setdefault(point.name, []).append(point)
            else:
                self._report([point], f"there is a {self._kind} of that name already")
        return by_name

    def _load(self, name: str) -> None:
        """Import the part of another package on first use."""
        if name in self._loaded or name not in self._entry_points:
            return
        self._loaded.add(name)
        points = self._entry_points[name]
        try:
            with foreign_code():
                if len(points) > 1:
                    raise ImportError("only one package may provide it; uninstall the others")
                factory = points[0].load()
                if name not in self._factories or self._factories[name] is not factory:
                    raise ImportError(
                        f"it is not registered by that name; decorate it by .register('{name}')"
                    )
                self._check_parameters(name)
            self._factories[name] = partial(self._call, points, factory)
        except ForeignError as error:
            # A broken package must not stop a tracker that does not use its part.
            self._unusable[name] = self._report(points, str(error))
            self._factories[name] = partial(self._refuse, name)
            self._parameters[name] = self._common

    def _call(
        self, points: Sequence[EntryPoint], factory: Callable[..., Part], *arguments: Any
    ) -> Part:
        """Call the factory of another package's part.

        Raises:
            ParameterError: It failed.
        """
        from pf_tracker_ros.parameters import ParameterError

        try:
            with foreign_code():
                return factory(*arguments)
        except ForeignError as error:
            if isinstance(error.__cause__, ParameterError):
                raise error.__cause__ from None
            raise ParameterError(self._message(points, str(error))) from error

    def _refuse(self, name: str, *arguments: Any, **keywords: Any) -> Any:
        """Factory of an unusable part: raises the reason."""
        self.check(name)

    def _check_parameters(self, name: str) -> None:
        """Check a part's tunables, and those that it shares with other parts.

        Raises:
            ParameterError: A default is not allowed.
            TypeError: A declaration is invalid, or differs from that of another part.
        """
        from pf_tracker_ros.parameters import check_declaration, declarations

        own = declarations(self._parameters[name])
        for one in own.values():
            check_declaration(one)
        for other in () if self.prefix else self._factories:
            for declared, theirs in declarations(self._parameters[other]).items():
                if own.get(declared, theirs) != theirs:
                    raise TypeError(
                        f"its parameter '{declared}' is declared differently than that of "
                        f"'{other}'; declare it alike, or rename it"
                    )

    def _report(self, points: Sequence[EntryPoint], reason: str) -> str:
        """Log that a part cannot be used; returns the message."""
        message = self._message(points, reason)
        logging.getLogger(__name__).warning(message)
        return message

    def _message(self, points: Sequence[EntryPoint], reason: str) -> str:
        where = " and ".join(
            f"{point.dist.name if point.dist else 'unknown'} ({point.value})" for point in points
        )
        return f"the {self._kind} '{points[0].name}' of {where} cannot be used: {reason}"


@cache
def _installed_entry_points() -> Any:
    """The entry points of all packages, of every group: reading them takes long."""
    # Imported here: only lists of parts need it.
    from importlib.metadata import EntryPoints, distributions, entry_points

    # Of all packages at once, which is faster, and fails if those of any package are damaged.
    with suppress(Exception):
        return entry_points()
    found: dict[str, EntryPoints] = {}
    for distribution in distributions():
        # The first one of a name is the one that Python imports.
        name = str(getattr(distribution, "_path", "unknown"))
        try:
            with foreign_code():
                name = distribution.metadata["Name"] or name
                if name not in found:
                    found[name] = distribution.entry_points
        except ForeignError as error:
            found[name] = EntryPoints()
            logging.getLogger(__name__).warning(
                "the entry points of the package %s cannot be read, so its parts are unknown: %s; "
                "install it again, or remove it",
                name,
                error,
            )
    return EntryPoints(point for points in found.values() for point in points)


def _top_package(name: str) -> str:
    return name.partition(":")[0].partition(".")[0]


def import_all(package: str, path: list[str]) -> None:
    """Import every module of a package, so that its parts are registered."""
    for module in sorted(found.name for found in pkgutil.iter_modules(path)):
        importlib.import_module(f"{package}.{module}")
