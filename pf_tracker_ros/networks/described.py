"""A network with its description, loaded once in a process."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar
from weakref import WeakValueDictionary

from pf_tracker_ros.networks.description import ModelDescription, description_path, read_model
from pf_tracker_ros.networks.engines import Network, Tensor, engine_name, load_network
from pf_tracker_ros.networks.onnx_files import file_hash, network_path
from pf_tracker_ros.parameters import ParameterError

Described = TypeVar("Described", bound="DescribedNetwork")


class DescribedNetwork(ABC):
    """A network with its description.

    A copy is the network itself. A pickle holds the path and the hashes, and reads the files again.

    Args:
        model: Folder of the model, or the path of its description.
        engine: auto, onnxruntime or opencv.

    Attributes:
        parameter: Name of the parameter with the folder, for messages.
        description: Its description.
        engine: The engine in use.
        hashes: Name of each file to its SHA-256.

    Raises:
        ParameterError: The network cannot be used; the message says why and what to do.
    """

    parameter: ClassVar[str]

    def __init__(self, model: str, engine: str = "auto") -> None:
        if not model:
            raise ParameterError(
                f"parameter '{self.parameter}' is empty; allowed: the folder of a network with its "
                "model.yaml, see docs/learned.md"
            )
        self._arguments = (model, engine)
        self.engine = engine_name(engine)
        self.description, folder = read_model(model)
        self.hashes: dict[str, str] = {}
        self._networks: dict[str, Network] = {}
        for name, expected in self._files().items():
            path = network_path(folder, name)
            try:
                found = file_hash(path)
            except ParameterError as error:
                raise ParameterError(
                    f"the network {self.description.name} cannot be used: {error}; it comes from "
                    f"{self.description.source}"
                ) from error
            if expected and found != expected.lower():
                raise ParameterError(
                    f"{path} is not the file that {self.description.name} describes: its SHA-256 "
                    f"is {found}, not {expected}"
                )
            self._networks[name] = load_network(path, self.engine)
            self.hashes[name] = found
        key = (type(self), self.description, self.engine, tuple(self.hashes.items()))
        if key not in _CHECKED:
            self._check()
            _CHECKED.add(key)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self._arguments, self.hashes)

    def __deepcopy__(self: Described, memo: dict[int, Any]) -> Described:
        return self

    @abstractmethod
    def _files(self) -> Mapping[str, str]:
        """Name of each used file to its expected hash, or to an empty string.

        Raises:
            ParameterError: The description is of another kind of network.
        """

    @abstractmethod
    def _check(self) -> None:
        """Run the network once, on an empty frame.

        Raises:
            ParameterError: It does not fit its description.
        """

    def _run(self, file: str, inputs: dict[str, Tensor], outputs: list[str]) -> list[Tensor]:
        """The named outputs of a file.

        Raises:
            ParameterError: It does not fit its description.
        """
        try:
            return self._networks[file].run(inputs, outputs)
        except Exception as error:
            # Each library has its own types of errors.
            reason = " ".join(str(error).split())
            raise ParameterError(
                f"the network {self.description.name} cannot run {file} as its description says "
                f"({reason})"
            ) from error


# Networks in use, by kind, path, engine and process.
_IN_USE: WeakValueDictionary[tuple[type, str, str, int], Any] = WeakValueDictionary()
# Networks that fit their descriptions.
_CHECKED: set[tuple[type, ModelDescription, str, tuple[tuple[str, str], ...]]] = set()


def open_network(kind: type[Described], model: str, engine: str = "auto") -> Described:
    """A network; one in use in this process is not read again, even if its files are gone.

    Args:
        kind: Class of the network.
        model: As of `DescribedNetwork`.
        engine: As of `DescribedNetwork`.

    Raises:
        ParameterError: As of `DescribedNetwork`.
    """
    # A forked process loads its own.
    key = (kind, model and str(description_path(model).absolute()), engine, os.getpid())
    network: Described | None = _IN_USE.get(key)
    if network is None:
        network = _IN_USE[key] = kind(model, engine)
    return network


def _restored(
    kind: type[Described], arguments: tuple[str, str], hashes: dict[str, str]
) -> Described:
    """The network again, from the same files.

    Raises:
        ParameterError: The files have changed.
    """
    network = kind(*arguments)
    if network.hashes != hashes:
        raise ParameterError(
            f"the files of the network in {arguments[0]} are not those of the copied tracker"
        )
    return network
