"""The command `model`: check the folder of a network."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence

import numpy as np

from pf_tracker_ros.command_lines import Parser
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.embedding import EmbeddingNetwork
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.parameters import ParameterError

_EXAMPLES = """\
example:
  model check ~/models/reid
"""

# Runs that are timed.
_TIMED = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    parser = Parser("model", description=__doc__, epilog=_EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    check = commands.add_parser("check", help="run a network and time it")
    check.add_argument("model", metavar="FOLDER", help="its folder, or the path of its description")
    check.add_argument(
        "--engine", choices=("auto", "onnxruntime", "opencv"), default="auto", help="[%(default)s]"
    )
    options = parser.parse_args(arguments)
    try:
        with one_opencv_thread():
            for line in _check(EmbeddingNetwork(options.model, options.engine)):
                print(line)
    except (ParameterError, OSError) as error:
        print(f"model: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    return 0


def _check(network: EmbeddingNetwork) -> Iterator[str]:
    """Describe a network, run it and time it."""
    description = network.description
    yield f"{description.name} in {network.folder}"
    yield f"license: {description.license}"
    yield f"source:  {description.source}"
    yield f"file:    {description.embedding.file}, SHA-256 {network.sha256}"
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    frame, boxes = Frame(image), np.array([[130.0, 90.0, 60.0, 60.0]])
    times = []
    for _ in range(_TIMED):
        start = time.process_time()
        vectors = network.embed(frame, boxes)
        times.append(time.process_time() - start)
    if not vectors.any():
        raise ParameterError(
            "the embedding of an image of noise is not finite, or 0; check the description, or "
            "export the network again"
        )
    yield f"vector:  {vectors.shape[1]} values"
    yield f"time:    {np.median(times) * 1e3:.1f} ms a detection with {network.engine}"
    yield "It runs as its description says."


if __name__ == "__main__":
    sys.exit(main())
