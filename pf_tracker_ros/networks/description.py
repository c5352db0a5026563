"""The description of a network: the file `model.yaml` in the folder of its ONNX file.

An embedding network, of the appearance `embedding`, converts the crop around a box to a vector;
vectors of one target are close to each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pf_tracker_ros.parameters import ParameterError, build, declared, group
from pf_tracker_ros.yaml_files import YamlError, read_yaml

DESCRIPTION_FILE = "model.yaml"
"""Name of the description in a model's folder."""


@dataclass(frozen=True)
class EmbeddingDescription:
    """A network from the crop of a box to a vector or a map, for re-identification."""

    file: str = declared("", "File name.")
    sha256: str = declared("", "Hash of the file; empty accepts any.")
    input: str = declared("input", "Name of the input.")
    output: str = declared("output", "Name of the output.")
    width: int = declared(128, "Width of the crop.", unit="px", minimum=8, maximum=4096)
    height: int = declared(256, "Height of the crop.", unit="px", minimum=8, maximum=4096)
    scale: float = declared(
        1.0, "Sides of the crop over those of the box.", minimum=0.1, maximum=20.0
    )
    rows: int = declared(
        1, "Parts from top to bottom in which a map is averaged.", minimum=1, maximum=64
    )
    columns: int = declared(
        1, "Parts from left to right in which a map is averaged.", minimum=1, maximum=64
    )
    distance_scale: float = declared(
        1.0,
        "Appearance distance over 1 minus the cosine of two vectors. Distances of one target's "
        "boxes should be about 0.12.",
        minimum=0.001,
        maximum=1000.0,
    )


@dataclass(frozen=True)
class ModelDescription:
    """A network."""

    name: str = declared("", "Name of the network.")
    license: str = declared("", "License of its weights.")
    source: str = declared("", "Where it comes from.")
    channels: str = declared("rgb", "Order of the color channels.", choices=("rgb", "bgr"))
    mean: tuple[float, ...] = declared(
        (0.0, 0.0, 0.0),
        "Subtracted from each channel.",
        lengths=(3,),
        minimum=-1e4,
        maximum=1e4,
    )
    deviation: tuple[float, ...] = declared(
        (1.0, 1.0, 1.0),
        "What each channel is then divided by.",
        lengths=(3,),
        minimum=1e-6,
        maximum=1e6,
    )
    embedding: EmbeddingDescription = group(EmbeddingDescription)


class Model(NamedTuple):
    """A description and where it was read from.

    Attributes:
        description: The description.
        folder: Folder of the files.
    """

    description: ModelDescription
    folder: Path


def description_path(model: str) -> Path:
    """The description that a folder, or the path of a description, stands for."""
    path = Path(model).expanduser()
    return path if path.suffix in (".yaml", ".yml") else path / DESCRIPTION_FILE


def read_model(model: str) -> Model:
    """Read the description of a model.

    Args:
        model: Its folder, or the path of its description.

    Raises:
        ParameterError: The description is missing or wrong; the message says what to do.
    """
    path = description_path(model)
    try:
        document = read_yaml(path, "description of a network")
        description = build(ModelDescription, dict(_flat(document, "")))
        if not description.embedding.file:
            raise ParameterError("'embedding.file' is empty; allowed: the name of a network's file")
        return Model(description, path.parent)
    except ModuleNotFoundError as error:
        raise ParameterError(f"{error}; a network needs PyYAML: pip install pyyaml") from error
    except YamlError as error:
        raise ParameterError(f"{error}; docs/identities.md has an example") from error
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _flat(document: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Full name and value of every setting of a YAML document."""
    if not isinstance(document, Mapping):
        raise ParameterError("the file has to hold names with values, see docs/identities.md")
    for name, value in document.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
