"""The description of a network: the file `model.yaml` in the folder of its ONNX files.

A Siamese network, of the cue `siamese`:

1. A crop around the target, the template, is read once; one around its predicted box, the search
   crop, in each frame.
2. A backbone may convert either crop to features.
3. The head compares both, and returns a score and a box for each cell of the search crop.

An embedding network, of the appearance `embedding`, converts the crop around a box to a vector;
vectors of one target are close to each other. A description may have either or both.

Descriptions of published networks are in `models/`; their files are not part of this package.
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

SHIPPED = Path(__file__).parent / "models"
"""Folder of the descriptions of published networks."""


@dataclass(frozen=True)
class CropDescription:
    """How a crop is cut out around a box of the target."""

    pixels: int = declared(128, "Side of the crop.", unit="px", minimum=8, maximum=4096)
    shape: str = declared(
        "square",
        "square keeps the shape of the image; box stretches the box to a square.",
        choices=("square", "box"),
    )
    scale: float = declared(
        2.0, "Side of the crop over that of the target.", minimum=1.0, maximum=20.0
    )
    context: float = declared(
        0.0,
        "What is added to width and height of a square crop before the scale, times width plus "
        "height.",
        minimum=0.0,
        maximum=4.0,
    )


@dataclass(frozen=True)
class BackboneDescription:
    """A network from a crop to features; without a file, the crop itself is the features."""

    file: str = declared("", "File name; empty without a backbone.")
    sha256: str = declared("", "Hash of the file; empty accepts any.")
    input: str = declared("input", "Name of the input.")
    output: str = declared("output", "Name of the output.")


@dataclass(frozen=True)
class BranchDescription:
    """One of the two branches, the template's or the search's."""

    crop: CropDescription = group(CropDescription)
    backbone: BackboneDescription = group(BackboneDescription)


@dataclass(frozen=True)
class HeadDescription:
    """The network that compares the features of both branches."""

    file: str = declared("", "File name.")
    sha256: str = declared("", "Hash of the file; empty accepts any.")
    template: str = declared("template", "Name of the input for the template's features.")
    search: str = declared("search", "Name of the input for the search crop's features.")
    score: str = declared("score", "Name of the output with a score for each cell.")
    score_kind: str = declared(
        "log_odds",
        "log_odds: one channel; two_classes: channels of background and target, before the "
        "softmax; probability: one channel, 0 to 1.",
        choices=("log_odds", "two_classes", "probability"),
    )
    boxes: str = declared("boxes", "Name of the output with a box for each cell.")
    box_kind: str = declared(
        "distances",
        "distances: 4 channels from a cell's point to left, top, right and bottom, pixels of the "
        "crop; sizes: 2 channels of width and height as shares of the crop, with offsets.",
        choices=("distances", "sizes"),
    )
    offsets: str = declared(
        "",
        "Name of the output with the offset of the center from each cell's corner, in cells; only "
        "for sizes.",
    )
    stride: float = declared(
        16.0, "Distance of two cells' points.", unit="px of the crop", minimum=1.0, maximum=256.0
    )
    score_slope: float = declared(
        1.0,
        "Log odds that a box is the target, over those of the network.",
        minimum=0.0,
        maximum=100.0,
    )
    score_offset: float = declared(
        0.0, "Log odds where those of the network are 0.", minimum=-100.0, maximum=100.0
    )


@dataclass(frozen=True)
class EmbeddingDescription:
    """A network from the crop of a box to a vector or a map, for re-identification."""

    file: str = declared("", "File name; empty without an embedding.")
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
    """A network: a Siamese one, an embedding, or both."""

    name: str = declared("", "Name of the network.")
    license: str = declared("", "License of its weights.")
    source: str = declared("", "Where it comes from.")
    color_only: bool = declared(
        False,
        "Whether the network is used in color images only, where other cues track the target too.",
    )
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
    template: BranchDescription = group(BranchDescription)
    search: BranchDescription = group(BranchDescription)
    head: HeadDescription = group(HeadDescription)
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
        if not (description.head.file or description.embedding.file):
            raise ParameterError(
                "'head.file' and 'embedding.file' are empty; either names the file of a network"
            )
        return Model(description, path.parent)
    except ModuleNotFoundError as error:
        raise ParameterError(f"{error}; a network needs PyYAML: pip install pyyaml") from error
    except YamlError as error:
        raise ParameterError(
            f"{error}; the command `model add` writes that of a published network"
        ) from error
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _flat(document: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Full name and value of every setting of a YAML document."""
    if not isinstance(document, Mapping):
        raise ParameterError("the file has to hold names with values, see `model add`")
    for name, value in document.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
