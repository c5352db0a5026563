"""A cue in a package of its own: likeness to the boxes that a Siamese network finds.

1. FEAR-XS compares a crop around the predicted box with the target's first box. It returns a box
   for each cell of the crop, with the log odds that it is the target.
2. The response of a box X is that of the candidate that is most like it:

       r(X) = max_i s_i exp(-d_i(X)^2 / 2)

   s_i is the probability of a candidate; d_i is the distance of the center, in box sides, and of
   the logarithms of width and height, each in its standard deviation.
3. The log likelihood falls linearly with the response. The network's template stays that of the
   first box; the other cues decide what is learned, and how sure the tracker is.

The files come from https://github.com/PinataFarms/FEARTracker (MIT), by `tools/convert_fear.py`.

Source: Borsuk et al. 2022, "FEAR: Fast, efficient, accurate and robust visual tracker".
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues import CUES, Cue, CueParameters
from pf_tracker_ros.cues.cue import declared_weight
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.networks.engines import engine_name, load_network
from pf_tracker_ros.parameters import ParameterError, declared

Floats = NDArray[np.float64]

# Files; outputs of the first, and of the second one.
_TEMPLATE_FILE, _SEARCH_FILE = "fear_noembs_init.onnx", "fear_noembs.onnx"
_FEATURES, _SCORES, _BOXES = "input.125", "cls", "bbox"
# Sides of the crops, pixels, and in sides of the box; distance of two cells, pixels of the crop.
_TEMPLATE_PIXELS, _SEARCH_PIXELS = 128, 256
_TEMPLATE_SCALE, _SEARCH_SCALE = 1.4, 5.0
_STRIDE = 16.0
# Log odds of a box over the network's, and where those are 0: fitted to the share of frames in
# which the likeliest box overlaps the target by half or more.
_SLOPE, _OFFSET = 0.52, -2.05
# Likeliest candidates that are compared with boxes.
_COMPARED = 12
# Standard deviations of a candidate's center, box sides, and of the logarithms of its sides.
_CENTER_STD, _SIZE_STD = 0.35, 0.6


@dataclass(frozen=True)
class SiameseParameters(CueParameters):
    """The Siamese cue."""

    weight: float = declared_weight(0.2)
    folder: str = declared("", f"Folder with {_TEMPLATE_FILE} and {_SEARCH_FILE}.", read_only=True)
    sharpness: float = declared(
        100.0, "How fast the log likelihood falls with the response.", minimum=0.0, maximum=1000.0
    )


@dataclass(frozen=True, eq=False)
class SiameseTemplate:
    """What the network knows of a target, from its first box.

    Attributes:
        features: Output of the network for the crop around the box.
        border: Mean color of the frame, which fills crops beyond the image.
    """

    features: NDArray[np.float32]
    border: tuple[float, ...]


class Candidates(NamedTuple):
    """Boxes that the network found in a frame.

    Attributes:
        boxes: (K, 4) x, y, width, height in pixels.
        probabilities: (K,) that each is the target.
    """

    boxes: Floats
    probabilities: Floats


# The entry point of this package names the class; the registry adds its name and parameters.
@CUES.register("siamese", SiameseParameters)
class Siamese(Cue):
    """Likeness to the candidates of the network.

    Args:
        parameters: Folder and sharpness.

    Raises:
        ParameterError: No folder is given, or the network cannot be read.
    """

    # Its likelihood is cheap on the whole search grid, once the network has run.
    joins_search = True

    def __init__(self, parameters: SiameseParameters) -> None:
        if not parameters.folder:
            raise ParameterError(
                "parameter 'siamese.folder' is empty; allowed: a folder with "
                f"{_TEMPLATE_FILE} and {_SEARCH_FILE}"
            )
        self._parameters = parameters
        # On ONNX Runtime where it is installed, else on OpenCV.
        self._template_network, self._search_network = (
            load_network(Path(parameters.folder).expanduser() / name, engine_name("auto"))
            for name in (_TEMPLATE_FILE, _SEARCH_FILE)
        )

    def __reduce__(self) -> tuple[Any, ...]:
        # Networks cannot be copied or pickled; a copy has those of the same files.
        return type(self), (self._parameters,)

    def learn(self, region: Region, box: Floats) -> SiameseTemplate:
        """See `Cue.learn`."""
        border = cv2.mean(region.frame.pixels)
        crop, _, _ = _crop(region.frame, box, _TEMPLATE_SCALE, _TEMPLATE_PIXELS, border)
        (features,) = self._template_network.run({"image_in": crop}, [_FEATURES])
        return SiameseTemplate(features, border)

    def observe(self, region: Region, box: Floats) -> tuple[Region, Floats]:
        """See `Cue.observe`; the network runs only where a template is needed."""
        return region, box

    def template_from(self, observation: tuple[Region, Floats]) -> SiameseTemplate:
        """See `Cue.template_from`."""
        return self.learn(*observation)

    def log_likelihood(self, region: Region, boxes: Floats, template: SiameseTemplate) -> Floats:
        """See `Cue.log_likelihood`; the same for all boxes where the network has no candidate."""
        around = boxes.mean(axis=0) if region.center_box is None else region.center_box
        # One run a frame and target, around the predicted box, which is read first.
        found: Candidates = region.frame.cached(
            ("siamese", template), lambda: self._find(region.frame, around, template)
        )
        likeness = np.exp(-0.5 * _squared_distances(found.boxes, boxes))
        responses = (found.probabilities[:, None] * likeness).max(axis=0, initial=0.0)
        log_likelihood: Floats = -self._parameters.sharpness * (1.0 - responses)
        return log_likelihood

    def match(self, observation: Any, template: SiameseTemplate) -> None:
        """See `Cue.match`; the other cues decide what is learned."""

    def blend(self, template: SiameseTemplate, observation: Any) -> SiameseTemplate:
        """See `Cue.blend`; the template stays."""
        return template

    def _find(self, frame: Frame, box: Floats, template: SiameseTemplate) -> Candidates:
        """The likeliest candidates around a (4,) box, pixels."""
        border = template.border
        crop, corner, size = _crop(frame, box, _SEARCH_SCALE, _SEARCH_PIXELS, border)
        inputs = {"image_in": crop, "template_features": template.features}
        scores, sides = self._search_network.run(inputs, [_SCORES, _BOXES])
        log_odds = _SLOPE * scores[0, 0].astype(np.float64) + _OFFSET
        rows, columns = np.indices(log_odds.shape)
        # Distances from a cell's point to left, top, right and bottom.
        points = np.stack([columns - columns.shape[1] // 2, rows - rows.shape[0] // 2])
        points = points * _STRIDE + _SEARCH_PIXELS / 2
        starts, ends = points - sides[0, :2], points + sides[0, 2:]
        boxes = np.concatenate([starts, ends - starts]).reshape(4, -1).T
        boxes = boxes * np.tile(size / _SEARCH_PIXELS, 2) + [*corner, 0.0, 0.0]
        with np.errstate(invalid="ignore"):
            usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] >= 1.0).all(axis=1)
        usable &= np.isfinite(log_odds.ravel())
        boxes, probabilities = boxes[usable], 1.0 / (1.0 + np.exp(-log_odds.ravel()[usable]))
        likeliest = np.argsort(-probabilities, kind="stable")[:_COMPARED]
        return Candidates(boxes[likeliest], probabilities[likeliest])


def _crop(
    frame: Frame, box: Floats, scale: float, pixels: int, border: tuple[float, ...]
) -> tuple[NDArray[np.float32], Floats, Floats]:
    """A part of a frame, stretched to a square.

    Args:
        frame: The frame.
        box: (4,) box in its middle, pixels.
        scale: Sides of the part over those of the box.
        pixels: Side of the square.
        border: Value of each channel beyond the image.

    Returns:
        (1, 3, pixels, pixels) RGB, 0 to 255; (2,) corner and (2,) size of the part, pixels.
    """
    size = np.maximum(box[2:], 1.0) * scale
    corner = box[:2] + box[2:] / 2 - size / 2
    step = size / pixels
    first = corner + step / 2 - 0.5
    image = cv2.warpAffine(
        frame.pixels,
        np.array([[step[0], 0.0, first[0]], [0.0, step[1], first[1]]]),
        (pixels, pixels),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )
    if image.ndim == 2:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    return cv2.dnn.blobFromImage(image, swapRB=True), corner, size


def _squared_distances(candidates: Floats, boxes: Floats) -> Floats:
    """(K, N) squared distances of (K, 4) candidates and (N, 4) boxes, standard deviations."""
    middle = boxes[:, :2] + boxes[:, 2:] / 2
    offsets = candidates[:, None, :2] + candidates[:, None, 2:] / 2 - middle
    ratios = np.log(candidates[:, None, 2:] / boxes[:, 2:])
    squared = np.square(offsets / (_CENTER_STD * boxes[:, 2:])) + np.square(ratios / _SIZE_STD)
    distances: Floats = squared.sum(axis=2)
    return distances
