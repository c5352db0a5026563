"""A Siamese network: boxes in a frame that look like the target, each with its probability.

1. A crop around the target's first box becomes the template: features, or the crop itself.
2. A larger crop around the predicted box is compared with it. Each cell of the result has a box
   and the log odds that it is the target.
3. The network's notion of the target's extent differs from that of whoever drew the first box. In
   the first frame, its box is compared with the given one, and later boxes are corrected by most
   of the difference.

Sources: Bertinetto et al. 2016, "Fully-convolutional Siamese networks for object tracking"; Li et
al. 2018, "High performance visual tracking with Siamese region proposal network" (boxes). Step 3
has no source.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.frame import PixelRect
from pf_tracker_ros.networks.description import (
    BranchDescription,
    CropDescription,
    HeadDescription,
    ModelDescription,
    description_path,
    read_model,
)
from pf_tracker_ros.networks.engines import Network, Tensor, engine_name, file_hash, load_network
from pf_tracker_ros.parameters import ParameterError

# Probabilities are limited to this distance from 0 and 1, so that their log odds are finite.
_LEAST_PROBABILITY = 1e-6
# Largest log odds, to either side.
_LARGEST_LOG_ODDS = 20.0
# Share of the difference of the network's first box from the given one by which later boxes are
# corrected; intersection over union below which the network's box is of something else.
_CORRECTION, _SAME_ABOVE = 0.75, 0.4
# Sides of the search crop beyond which a box is no box.
_LARGEST_BOX = 10.0
# Channels of the outputs.
_SCORE_CHANNELS = {"log_odds": 1, "two_classes": 2, "probability": 1}
_BOX_CHANNELS = {"distances": 4, "sizes": 2}


@dataclass(frozen=True, eq=False)
class NetworkTemplate:
    """What the network knows of a target.

    Attributes:
        features: Output of the template's branch.
        border: Mean color of the template's frame, which fills crops beyond the image.
        size_ratio: (2,) factors of width and height that correct the network's boxes.
        offset: (2,) correction of the center, sides of the network's box.
    """

    features: Tensor
    border: tuple[float, ...]
    size_ratio: NDArray[np.float64] = field(default_factory=lambda: np.ones(2))
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))


class Candidates(NamedTuple):
    """Boxes that the network found in a frame.

    Attributes:
        boxes: (M, 4), pixels of the frame, with sides of at least one pixel.
        log_odds: (M,) that each is the target.
        left_out: Number of cells without a usable box or score.
    """

    boxes: NDArray[np.float64]
    log_odds: NDArray[np.float64]
    left_out: int = 0

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """(M,) that each is the target."""
        probabilities: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-self.log_odds))
        return probabilities

    def likeliest(self, count: int) -> Candidates:
        """The likeliest candidates, the best first."""
        order = np.argsort(-self.log_odds, kind="stable")[:count]
        return Candidates(self.boxes[order], self.log_odds[order])


class _Crop(NamedTuple):
    """A part of a frame: (2,) corner and (2,) size, pixels."""

    corner: NDArray[np.float64]
    size: NDArray[np.float64]


class SiameseNetwork:
    """A Siamese network with its description.

    A copy is the network itself. A pickle holds the path and the hashes, and reads the files again.

    Args:
        model: Folder of the model, or the path of its description.
        engine: auto, onnxruntime or opencv.

    Attributes:
        description: Its description.
        engine: The engine in use.
        hashes: Name of each file to its SHA-256.

    Raises:
        ParameterError: The network cannot be used; the message says why and what to do.
    """

    def __init__(self, model: str, engine: str = "auto") -> None:
        if not model:
            raise ParameterError(
                "parameter 'siamese.model' is empty; allowed: the folder of a network with its "
                "model.yaml, see docs/learned.md"
            )
        self._arguments = (model, engine)
        self.engine = engine_name(engine)
        self.description, folder = read_model(model)
        self.hashes: dict[str, str] = {}
        self._networks: dict[str, Network] = {}
        for name, expected in self.description.files().items():
            path = folder / name
            try:
                found = file_hash(path)
                if expected and found != expected.lower():
                    raise ParameterError(
                        f"{path} is not the file that {self.description.name} describes: its "
                        f"SHA-256 is {found}, not {expected}"
                    )
                self._networks[name] = load_network(path, self.engine)
            except OSError as error:
                raise ParameterError(
                    f"the network {self.description.name} needs {path}, which cannot be read "
                    f"({error.strerror}); it comes from {self.description.source}"
                ) from error
            self.hashes[name] = found
        self._check()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self._arguments, self.hashes)

    def __deepcopy__(self, memo: dict[int, Any]) -> SiameseNetwork:
        return self

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> NetworkTemplate:
        """Template of a (4,) box, pixels.

        Raises:
            ParameterError: The network does not fit its description.
        """
        view = frame.pixels
        border = cv2.mean(view)[: 1 if view.ndim == 2 else 3]
        features, _ = self._features(frame, box, self.description.template, border)
        template = NetworkTemplate(features, border)
        likeliest = self.find(frame, template, box).likeliest(1).boxes
        if not len(likeliest) or pairwise_iou(likeliest, box[None])[0, 0] < _SAME_ABOVE:
            return template
        (own,) = likeliest
        size_ratio = (box[2:] / own[2:]) ** _CORRECTION
        offset = _CORRECTION * (box[:2] + box[2:] / 2 - own[:2] - own[2:] / 2) / own[2:]
        return replace(template, size_ratio=size_ratio, offset=offset)

    def find(self, frame: Frame, template: NetworkTemplate, box: NDArray[np.float64]) -> Candidates:
        """One candidate for each cell around a (4,) box, pixels, but for cells without a box.

        Raises:
            ParameterError: The network does not fit its description.
        """
        branch, head = self.description.search, self.description.head
        features, crop = self._features(frame, box, branch, template.border)
        names = [head.score, head.boxes, *([head.offsets] if head.offsets else [])]
        inputs = {head.template: template.features, head.search: features}
        outputs = self._run(head.file, inputs, names)
        self._check_shapes(outputs)
        log_odds = _log_odds(outputs[0][0], head)
        boxes = _boxes(outputs, head, branch.crop.pixels)
        usable = _are_boxes(boxes, branch.crop.pixels) & np.isfinite(log_odds)
        boxes, log_odds = boxes[usable], log_odds[usable]
        boxes *= np.tile(crop.size / branch.crop.pixels, 2)
        sizes = boxes[:, 2:] * template.size_ratio
        centers = boxes[:, :2] + crop.corner + boxes[:, 2:] * (0.5 + template.offset)
        boxes = np.hstack([centers - sizes / 2, np.maximum(sizes, 1.0)])
        return Candidates(boxes, log_odds, left_out=int(np.sum(~usable)))

    def _check(self) -> None:
        """Run the network once, on an empty frame.

        Raises:
            ParameterError: It does not fit its description.
        """
        key = (self.description, self.engine, tuple(self.hashes.items()))
        if key not in _CHECKED:
            frame, box = Frame(np.zeros((64, 64), np.uint8)), np.array([16.0, 16.0, 32.0, 32.0])
            if not len(self.find(frame, self.learn(frame, box), box).boxes):
                raise ParameterError(
                    f"the network {self.description.name} finds no box in any cell: scores or "
                    "boxes are not finite, or all boxes have no sides or are far from the crop; "
                    "check box_kind, mean and deviation in its description, or export it again"
                )
            _CHECKED.add(key)

    def _features(
        self,
        frame: Frame,
        box: NDArray[np.float64],
        branch: BranchDescription,
        border: tuple[float, ...],
    ) -> tuple[Tensor, _Crop]:
        """Features of a crop around a (4,) box, and the crop."""
        crop = _crop_around(box, branch.crop)
        values = self._normalized(_read_crop(frame, crop, branch.crop.pixels, border))
        backbone = branch.backbone
        if backbone.file:
            (values,) = self._run(backbone.file, {backbone.input: values}, [backbone.output])
        return values, crop

    def _normalized(self, pixels: NDArray[np.uint8]) -> Tensor:
        """(1, 3, side, side) input of the network from (side, side) or (side, side, 3) pixels."""
        if pixels.ndim == 2:
            pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
        elif self.description.channels == "rgb":
            pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
        mean = np.array(self.description.mean, np.float32)
        deviation = np.array(self.description.deviation, np.float32)
        values = (pixels.astype(np.float32) - mean) / deviation
        return np.ascontiguousarray(values.transpose(2, 0, 1)[None])

    def _run(self, file: str, inputs: dict[str, Tensor], outputs: list[str]) -> list[Tensor]:
        try:
            return self._networks[file].run(inputs, outputs)
        except Exception as error:
            # Each library has its own types of errors.
            reason = " ".join(str(error).split())
            raise ParameterError(
                f"the network {self.description.name} cannot run {file} as its description says "
                f"({reason})"
            ) from error

    def _check_shapes(self, outputs: list[Tensor]) -> None:
        head = self.description.head
        cells = outputs[0].shape[-2:]
        named = [(head.score, _SCORE_CHANNELS[head.score_kind])]
        named.append((head.boxes, _BOX_CHANNELS[head.box_kind]))
        if head.offsets:
            named.append((head.offsets, 2))
        for (name, channels), values in zip(named, outputs, strict=True):
            expected = (1, channels, *cells)
            if values.shape != expected:
                raise ParameterError(
                    f"the output {name} of the network {self.description.name} has the shape "
                    f"{values.shape}; its description requires {expected}"
                )
        extent, pixels = (max(cells) - 1) * head.stride, self.description.search.crop.pixels
        if extent > pixels:
            raise ParameterError(
                f"the cells of the network {self.description.name} span {extent:g} px, more than "
                f"its search crop of {pixels} px: 'head.stride' or 'search.crop.pixels' in its "
                "description is wrong"
            )


# Networks in use, by path, engine and process.
_IN_USE: WeakValueDictionary[tuple[str, str, int], SiameseNetwork] = WeakValueDictionary()


def open_network(model: str, engine: str) -> SiameseNetwork:
    """A network; one in use in this process is not read again, even if its files are gone.

    Args:
        model: As of `SiameseNetwork`.
        engine: As of `SiameseNetwork`.

    Raises:
        ParameterError: As of `SiameseNetwork`.
    """
    # A forked process loads its own.
    key = (model and str(description_path(model).absolute()), engine, os.getpid())
    network = _IN_USE.get(key)
    if network is None:
        network = _IN_USE[key] = SiameseNetwork(model, engine)
    return network


# Networks that fit their descriptions.
_CHECKED: set[tuple[ModelDescription, str, tuple[tuple[str, str], ...]]] = set()


def _restored(
    network_type: type[SiameseNetwork], arguments: tuple[str, str], hashes: dict[str, str]
) -> SiameseNetwork:
    """The network again, from the same files.

    Raises:
        ParameterError: The files have changed.
    """
    network = network_type(*arguments)
    if network.hashes != hashes:
        raise ParameterError(
            f"the files of the network in {arguments[0]} are not those of the copied tracker"
        )
    return network


def _crop_around(box: NDArray[np.float64], rules: CropDescription) -> _Crop:
    """The crop around a (4,) box, pixels."""
    size = np.maximum(box[2:], 1.0)
    if rules.shape == "square":
        with_context = size + rules.context * size.sum()
        size = np.full(2, math.sqrt(with_context[0] * with_context[1]))
    size = size * rules.scale
    return _Crop(box[:2] + box[2:] / 2 - size / 2, size)


def _read_crop(
    frame: Frame, crop: _Crop, pixels: int, border: tuple[float, ...]
) -> NDArray[np.uint8]:
    """(pixels, pixels) or (pixels, pixels, 3) of a part of a frame, with a border beyond it."""
    reduction = max(int(crop.size.min() / pixels), 1)
    # From here on, pixels are those of the reduced view.
    corner, size = crop.corner / reduction, crop.size / reduction
    (left, right), (top, bottom) = (
        _inside(start, start + length, -(-limit // reduction))
        for start, length, limit in zip(corner, size, frame.size, strict=True)
    )
    step = size / pixels
    first = corner + step / 2 - (left, top) - 0.5
    return cv2.warpAffine(
        frame.view(PixelRect(top, bottom, left, right), reduction),
        np.array([[step[0], 0.0, first[0]], [0.0, step[1], first[1]]]),
        (pixels, pixels),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )


def _inside(start: float, end: float, length: int) -> tuple[int, int]:
    """Pixel range [first, last) that covers start to end and one more, at least 1, in a length."""
    first = min(max(math.floor(start) - 1, 0), length - 1)
    return first, max(min(math.ceil(end) + 1, length), first + 1)


def _log_odds(scores: Tensor, head: HeadDescription) -> NDArray[np.float64]:
    """(M,) log odds of (channels, rows, columns) scores; not a number where a score is none."""
    values = scores.astype(np.float64).reshape(len(scores), -1)
    if head.score_kind == "two_classes":
        odds = values[1] - values[0]
    elif head.score_kind == "probability":
        probability = np.clip(values[0], _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
        odds = np.log(probability / (1.0 - probability))
    else:
        odds = values[0]
    scaled = head.score_slope * odds + head.score_offset
    limit = _LARGEST_LOG_ODDS
    return np.clip(scaled, -limit, limit)


def _boxes(outputs: list[Tensor], head: HeadDescription, pixels: int) -> NDArray[np.float64]:
    """(M, 4) boxes in pixels of the crop."""
    values = outputs[1][0].astype(np.float64)
    rows, columns = values.shape[1:]
    values = values.reshape(len(values), -1)
    row, column = np.divmod(np.arange(rows * columns), columns)
    cells = np.stack([column, row])
    if head.box_kind == "sizes":
        offsets = 0.5 if not head.offsets else outputs[2][0].astype(np.float64).reshape(2, -1)
        centers, sizes = (cells + offsets) * head.stride, values * pixels
        return np.concatenate([centers - sizes / 2, sizes]).T.copy()
    middle = np.array([[columns // 2], [rows // 2]])
    points = (cells - middle) * head.stride + pixels / 2
    corners, ends = points - values[:2], points + values[2:]
    return np.concatenate([corners, ends - corners]).T.copy()


def _are_boxes(boxes: NDArray[np.float64], pixels: int) -> NDArray[np.bool_]:
    """(M,) whether (M, 4) boxes, pixels of the crop, have sides and are somewhere near the crop."""
    # Comparisons with values that are not finite are false.
    near = np.all(np.abs(boxes) <= _LARGEST_BOX * pixels, axis=1)
    has_sides: NDArray[np.bool_] = np.all(boxes[:, 2:] > 0.0, axis=1)
    return near & has_sides
