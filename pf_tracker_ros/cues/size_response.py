"""Size response cue: how large the target is, told by a filter along its size.

Boxes hardly differ in likelihood when they grow by a few percent around the same center. A linear
filter that is trained to answer most at the target's own size, and less to the same place seen a
little larger or smaller, tells them apart. It is asked once a frame, at the place where the
particles are likeliest; each particle reads the answer at its own size.

Source: Danelljan, Haeger, Khan, Felsberg 2017, "Discriminative scale space tracking", section 4;
here the filter is a ridge regression over the sizes instead of a circular correlation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import Match, declared_power
from pf_tracker_ros.cues.deferred import DeferredCue, View, declared_training_interval
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.cues.matrix_product import product
from pf_tracker_ros.cues.window_features import CELL_PIXELS, gradient_features
from pf_tracker_ros.cues.windows import Crop
from pf_tracker_ros.parameters import declared

# Side of the patch that the target is brought to, whatever its shape.
_PATCH = 8 * CELL_PIXELS
# Ridge, in the mean energy of a patch.
_RIDGE = 0.01


@dataclass(frozen=True)
class SizeResponseParameters:
    """The size response cue."""

    power: float = declared_power(0.0)
    sizes: int = declared(
        17,
        "Sizes that are compared each frame; an even number counts as the odd one above.",
        minimum=3,
        maximum=65,
        read_only=True,
    )
    step: float = declared(
        1.02,
        "Factor from one of these sizes to the next.",
        minimum=1.001,
        maximum=1.5,
        read_only=True,
    )
    peak_width: float = declared(
        1.0,
        "Standard deviation of the trained answer.",
        unit="steps",
        minimum=0.1,
        maximum=20.0,
        read_only=True,
    )
    sharpness: float = declared(
        100.0,
        "How fast the likelihood falls as the response does.",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared(
        0.995,
        "Share of the old filter that each frame that it learns from keeps.",
        minimum=0.0,
        maximum=1.0,
    )
    training_interval: int = declared_training_interval()


@dataclass(frozen=True, eq=False)
class SizeTemplate:
    """A filter along the size.

    Attributes:
        weights: (features,) of the filter.
        waiting: Frames that could have been learned from since the last training.
    """

    weights: NDArray[np.float32]
    waiting: int = 0


class SizeResponse(DeferredCue):
    """Response of a linear filter to the target at several sizes.

    Args:
        parameters: Sizes and sharpness.
    """

    def __init__(self, parameters: SizeResponseParameters) -> None:
        steps = parameters.sizes // 2
        offsets = np.arange(-steps, steps + 1)
        self._offsets = offsets
        self._factors = parameters.step**offsets
        self._log_step = math.log(parameters.step)
        self._answer = np.exp(-0.5 * np.square(offsets / parameters.peak_width))
        window = np.hanning(len(offsets) + 2)[1:-1]
        self._window = window[:, None].astype(np.float32)
        self._sharpness = parameters.sharpness
        self._interval = parameters.training_interval
        self._keep = parameters.keep**self._interval

    @property
    def needs_place(self) -> bool:
        """See `Cue.needs_place`."""
        return True

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> SizeTemplate:
        """See `Cue.learn`."""
        patches = self._patches(maps, box)
        energy = product(patches, patches.T)
        ridge = _RIDGE * np.trace(energy) / len(energy) + 1e-9
        solution = np.linalg.solve(energy + ridge * np.eye(len(energy)), self._answer)
        return SizeTemplate(solution.astype(np.float32) @ patches)

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: SizeTemplate
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`."""
        place = maps.place
        response = self._patches(maps, place) @ template.weights
        sizes = np.sqrt(boxes[:, 2] * boxes[:, 3])
        steps = np.log(sizes / math.sqrt(place[2] * place[3])) / self._log_step
        values = np.interp(steps, self._offsets, response)
        return -self._sharpness * (1.0 - np.clip(values, 0.0, 1.0))

    def match(self, seen: View, template: SizeTemplate) -> Match | None:
        """See `Cue.match`; any size of anything may look like the right one."""
        return None

    def blend(self, template: SizeTemplate, seen: View, keep: float) -> SizeTemplate:
        """See `Cue.blend`; the filter's own share takes the place of `keep`."""
        waiting = template.waiting + 1
        if waiting < self._interval:
            return replace(template, waiting=waiting)
        share = np.float32(self._keep)
        learned = self.learn(seen.maps, seen.box)
        return SizeTemplate(share * template.weights + (1 - share) * learned.weights)

    def _patches(self, maps: FrameMaps, box: NDArray[np.float64]) -> NDArray[np.float32]:
        """(sizes, features) of the place of a (4,) box at all sizes, more towards the middle."""
        center, sides = box[:2] + box[2:] / 2, box[2:]
        crop = Crop(maps.image, center, sides * self._factors[-1], _PATCH, gray=True)
        stack = [crop.window(center, sides * factor, _PATCH) for factor in self._factors]
        features = gradient_features(np.concatenate(stack))
        channels, _, columns = features.shape
        by_patch = features.reshape(channels, len(self._factors), -1, columns).transpose(1, 0, 2, 3)
        return by_patch.reshape(len(self._factors), -1) * self._window
