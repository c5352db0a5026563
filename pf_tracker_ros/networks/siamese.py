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

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.crops import Crop, crop_around, mean_color, normalized, read_crop
from pf_tracker_ros.networks.described import DescribedNetwork
from pf_tracker_ros.networks.description import (
    BranchDescription,
    CropDescription,
    HeadDescription,
)
from pf_tracker_ros.networks.engines import Tensor
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
# Least mean range of a pixel's channels in a color image, gray levels; sides of the target and
# pixels of the crop in which it is measured.
_LEAST_COLOR, _COLOR_SCALE, _COLOR_PIXELS = 2.0, 2.0, 32
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


class SiameseNetwork(DescribedNetwork):
    """A Siamese network with its description; see `DescribedNetwork`."""

    parameter = "siamese.model"

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> NetworkTemplate:
        """Template of a (4,) box, pixels.

        Raises:
            ParameterError: The network does not fit its description.
        """
        border = mean_color(frame)
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

    def suits(self, frame: Frame, box: NDArray[np.float64]) -> bool:
        """Whether the network is meant for the image around a (4,) box, pixels."""
        if not self.description.color_only:
            return True
        if frame.pixels.ndim == 2:
            return False
        crop = crop_around(box, CropDescription(scale=_COLOR_SCALE))
        pixels = read_crop(frame, crop, (_COLOR_PIXELS, _COLOR_PIXELS), mean_color(frame))
        return float(np.ptp(pixels, axis=2).mean()) >= _LEAST_COLOR

    def _files(self) -> dict[str, str]:
        """See `DescribedNetwork._files`."""
        if not self.description.head.file:
            raise ParameterError(
                f"the network {self.description.name} has no 'head.file' in its description, so it "
                "does not find a target; allowed: a Siamese network"
            )
        branches = self.description.template.backbone, self.description.search.backbone
        parts = (*branches, self.description.head)
        return {part.file: part.sha256 for part in parts if part.file}

    def _check(self) -> None:
        """See `DescribedNetwork._check`."""
        frame, box = Frame(np.zeros((64, 64), np.uint8)), np.array([16.0, 16.0, 32.0, 32.0])
        if not len(self.find(frame, self.learn(frame, box), box).boxes):
            raise ParameterError(
                f"the network {self.description.name} finds no box in any cell: scores or "
                "boxes are not finite, or all boxes have no sides or are far from the crop; "
                "check box_kind, mean and deviation in its description, or export it again"
            )

    def _features(
        self,
        frame: Frame,
        box: NDArray[np.float64],
        branch: BranchDescription,
        border: tuple[float, ...],
    ) -> tuple[Tensor, Crop]:
        """Features of a crop around a (4,) box, and the crop."""
        crop, pixels = crop_around(box, branch.crop), branch.crop.pixels
        values = normalized(read_crop(frame, crop, (pixels, pixels), border), self.description)
        backbone = branch.backbone
        if backbone.file:
            (values,) = self._run(backbone.file, {backbone.input: values}, [backbone.output])
        return values, crop

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
