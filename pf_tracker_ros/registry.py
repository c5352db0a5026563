"""Parts that are chosen by name, each registered where it is written."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Part = TypeVar("Part")
Registered = TypeVar("Registered", bound=Callable[..., Any])


@dataclass(frozen=True)
class NoParameters:
    """The group of a part that has no tunables."""


class Registry(Mapping[str, Callable[..., Part]], Generic[Part]):
    """Name to what makes a part, in the order in which they registered.

    Args:
        kind: What the parts are, for messages.
        parameters: The group of tunables that those of every part are derived from.
    """

    def __init__(self, kind: str, parameters: type = NoParameters) -> None:
        self._kind = kind
        self._common = parameters
        self._makers: dict[str, Callable[..., Part]] = {}
        self._parameters: dict[str, type] = {}

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
        return self._parameters[name]

    def __getitem__(self, name: str) -> Callable[..., Part]:
        return self._makers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def import_all(package: str, path: list[str]) -> None:
    """Import every module of a package, so that what is in them registers itself.

    Args:
        package: Its name.
        path: Its `__path__`.
    """
    for module in sorted(found.name for found in pkgutil.iter_modules(path)):
        importlib.import_module(f"{package}.{module}")
