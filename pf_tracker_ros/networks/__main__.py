"""The command `model`: describe and check the folder of a network."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pf_tracker_ros.atomic_files import atomic_write
from pf_tracker_ros.command_lines import Parser
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.described import DescribedNetwork
from pf_tracker_ros.networks.description import DESCRIPTION_FILE, SHIPPED, read_model
from pf_tracker_ros.networks.embedding import EmbeddingNetwork
from pf_tracker_ros.networks.onnx_files import file_hash, network_path
from pf_tracker_ros.networks.siamese import SiameseNetwork
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.yaml_files import read_yaml

_EXAMPLES = """\
examples:
  model add fear_xs_without_embedding ~/models/fear
  model check ~/models/fear
  ros2 run pf_tracker_ros tracker --ros-args -p preset:=learned -p siamese.model:=~/models/fear
"""
Result = TypeVar("Result")

# Runs that are timed.
_TIMED = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    parser = Parser("model", description=__doc__, epilog=_EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    add = commands.add_parser("add", help="write the description of a published network")
    names = sorted(path.stem for path in SHIPPED.glob("*.yaml"))
    add.add_argument("name", choices=names, metavar="NAME", help=", ".join(names))
    add.add_argument("folder", type=Path, metavar="FOLDER", help="folder with the network's files")
    check = commands.add_parser("check", help="run a network once and time it")
    check.add_argument("model", metavar="FOLDER", help="its folder, or the path of its description")
    check.add_argument(
        "--engine", choices=("auto", "onnxruntime", "opencv"), default="auto", help="[%(default)s]"
    )
    options = parser.parse_args(arguments)
    try:
        lines = (
            _add(options.name, options.folder)
            if options.command == "add"
            else _check(options.model, options.engine)
        )
        for line in lines:
            print(line)
    except (ParameterError, OSError) as error:
        print(f"model: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    return 0


def _add(name: str, folder: Path) -> Iterator[str]:
    """Write the description of a published network with the hashes of the files in a folder."""
    import yaml

    document = read_yaml(SHIPPED / f"{name}.yaml", "description of a network")
    for part in _parts_with_files(document):
        path = network_path(folder, part["file"])
        if not path.exists():
            raise ParameterError(f"{path} is missing; it comes from {document['source']}")
        part["sha256"] = file_hash(path)
    target = folder / DESCRIPTION_FILE
    try:
        with atomic_write(target, may_replace=False) as draft:
            draft.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    except FileExistsError as error:
        raise ParameterError(
            f"{target} exists; `model check` tells whether it fits the files; remove it to write "
            "it anew"
        ) from error
    yield f"wrote {target}; its license: {document['license']}"


def _parts_with_files(document: Any) -> Iterator[dict[str, Any]]:
    """Every group of settings that names a file."""
    if isinstance(document, dict):
        if "file" in document:
            yield document
        for value in document.values():
            yield from _parts_with_files(value)


def _check(model: str, engine: str) -> Iterator[str]:
    """Describe a network, and time it."""
    description, folder = read_model(model)
    yield f"{description.name} in {folder}"
    yield f"license: {description.license}"
    yield f"source:  {description.source}"
    with one_opencv_thread():
        if description.head.file:
            yield from _check_head(SiameseNetwork(model, engine))
        if description.embedding.file:
            yield from _check_embedding(EmbeddingNetwork(model, engine))
    yield "It runs as its description says."


def _check_head(network: SiameseNetwork) -> Iterator[str]:
    """Run a Siamese network, and time it."""
    yield from _files_of(network)
    frame, box = _example()
    template = network.learn(frame, box)
    found, milliseconds = _timed(lambda: network.find(frame, template, box))
    cells = len(found.boxes) + found.left_out
    if found.left_out > cells / 2:
        raise ParameterError(
            f"{found.left_out} of {cells} cells have no finite score and box near the crop on an "
            "image of noise; check the description, or export the network again"
        )
    yield f"cells:   {cells}" + (f", {found.left_out} without a box" if found.left_out else "")
    yield f"time:    {milliseconds:.1f} ms a target and frame with {network.engine}"


def _check_embedding(network: EmbeddingNetwork) -> Iterator[str]:
    """Run an embedding network, and time it."""
    yield from _files_of(network)
    frame, box = _example()
    vectors, milliseconds = _timed(lambda: network.embed(frame, box[None]))
    if not vectors.any():
        raise ParameterError(
            "the embedding of an image of noise is not finite, or 0; check the description, or "
            "export the network again"
        )
    yield f"vector:  {vectors.shape[1]} values"
    yield f"time:    {milliseconds:.1f} ms a detection with {network.engine}"


def _files_of(network: DescribedNetwork) -> Iterator[str]:
    for name, sha256 in network.hashes.items():
        yield f"file:    {name}, SHA-256 {sha256}"


def _timed(run: Callable[[], Result]) -> tuple[Result, float]:
    """The last result of some runs, and their median time in milliseconds."""
    times = []
    for _ in range(_TIMED):
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
    return result, float(np.median(times)) * 1e3


def _example() -> tuple[Frame, np.ndarray[Any, np.dtype[np.float64]]]:
    """A frame of noise and a box in it."""
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    return Frame(image), np.array([130.0, 90.0, 60.0, 60.0])


if __name__ == "__main__":
    sys.exit(main())
