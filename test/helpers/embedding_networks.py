"""A small embedding network, and its description."""

import numpy as np
from small_networks import integers, network, node, tensor, value

SIDE = 16
EMBEDDING = f"""\
name: mean colors
license: CC0-1.0
source: the tests
deviation: [255.0, 255.0, 255.0]
embedding:
  file: colors.onnx
  width: {SIDE}
  height: {2 * SIDE}
  rows: 2
"""


def mean_colors(bias=0.0, shapes=True):
    """The bytes of an embedding network: the channels of parts of 8 x 8 pixels, and a constant.

    Args:
        bias: Added to each mean.
        shapes: Whether the output has a shape.
    """
    weights = np.zeros((3, 3, 8, 8))
    weights[range(3), range(3)] = 1 / 64
    place = integers("kernel_shape", 8, 8), integers("strides", 8, 8)
    return network(
        [node("Conv", ["input", "weights", "bias"], "output", *place)],
        [tensor("weights", weights), tensor("bias", np.full(3, bias))],
        [value("input", (1, 3, 2 * SIDE, SIDE))],
        [value("output", (1, 3, SIDE // 4, SIDE // 8) if shapes else ())],
    )
