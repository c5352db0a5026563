"""Converts the Core ML file of FEAR-XS to the ONNX format, for the example of a Siamese cue.

    pip install coremltools onnx
    git clone --depth 1 https://github.com/PinataFarms/FEARTracker
    python tools/convert_fear.py FEARTracker ~/models/fear

It writes fear_noembs_init.onnx and fear_noembs.onnx, of FEAR-XS without its embedding. Core ML's
layers have their counterparts in ONNX; weights are unpacked to single precision. There is one Core
ML file: the template branch is the part of the search branch up to the features, for a smaller
image.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

# ONNX operators and file format of this version, which OpenCV 4.6 and later read.
_OPERATORS, _FORMAT = 13, 7
# Sides of the crops, pixels; shapes of the template's features and of the other outputs.
_TEMPLATE_SIDE, _SEARCH_SIDE = 128, 256
_FEATURES = (1, 256, 8, 8)
_OUTPUTS = {"bbox": (1, 4, 16, 16), "cls": (1, 1, 16, 16)}
# Fields of the padding at the start and at the end of an axis.
_SIDES = ("startEdgeSize", "endEdgeSize")
_SOURCE = "evaluate/MeasurePerformance/MeasurePerformance/models/FEAR-XS-NoEmbs.mlmodel"


class Conversion(NamedTuple):
    """One file to write.

    Attributes:
        target: Name of the written file.
        side: Side of the image, pixels.
        until: Name of the output, if it is not the last one of the file.
    """

    target: str
    side: int
    until: str = ""


_CONVERSIONS = (
    Conversion("fear_noembs_init.onnx", _TEMPLATE_SIDE, "input.125"),
    Conversion("fear_noembs.onnx", _SEARCH_SIDE),
)


class UnknownLayerError(ValueError):
    """A layer that this program does not convert."""


class Converter:
    """Converts the layers of a Core ML network one by one.

    Args:
        specification: Core ML's specification of the network.
    """

    def __init__(self, specification: Any) -> None:
        self._specification = specification
        self._nodes: list[Any] = []
        self._tensors: list[Any] = []

    def convert(self, side: int, until: str = "") -> Any:
        """The network in the ONNX format.

        Args:
            side: Side of the image, pixels.
            until: Name of the output; empty for those of the network.

        Raises:
            UnknownLayerError: A layer cannot be converted.
        """
        from onnx import helper

        network = self._specification.neuralNetwork
        (scaler,) = (one.scaler for one in network.preprocessing)
        bias = np.array([scaler.redBias, scaler.greenBias, scaler.blueBias], np.float32)
        (image,) = (
            one.name
            for one in self._specification.description.input
            if one.type.HasField("imageType")
        )
        scale = np.float32(scaler.channelScale)
        self._add("Mul", ["image_in", self._tensor("image_scale", scale)], "image_scaled_by_one")
        self._add("Add", ["image_scaled_by_one", self._tensor("bias", bias[:, None, None])], image)
        for layer in network.layers:
            self._layer(layer)
            if until in layer.output:
                break
        inputs = [_value("image_in", (1, 3, side, side))]
        if any("template_features" in node.input for node in self._nodes):
            inputs.append(_value("template_features", _FEATURES))
        names = [until] if until else [one.name for one in self._specification.description.output]
        outputs = [_value(name, _OUTPUTS.get(name, _FEATURES)) for name in names]
        graph = helper.make_graph(self._nodes, "FEAR", inputs, outputs, self._tensors)
        operators = helper.make_opsetid("", _OPERATORS)
        return helper.make_model(graph, opset_imports=[operators], ir_version=_FORMAT)

    def _layer(self, layer: Any) -> None:
        kind = layer.WhichOneof("layer")
        names, outputs = list(layer.input), list(layer.output)
        values = getattr(layer, kind)
        if kind == "convolution":
            self._convolution(layer.name, values, names, outputs)
        elif kind == "activation" and values.WhichOneof("NonlinearityType") == "ReLU":
            self._add("Relu", names, *outputs)
        elif kind == "add":
            self._add("Add", names, *outputs)
        elif kind == "scale" and not values.hasBias:
            factor = _weights(values.scale).reshape(-1, 1, 1)
            self._add("Mul", [*names, self._tensor(f"{layer.name}.scale", factor)], *outputs)
        elif kind == "reshapeStatic":
            shape = np.array(list(values.targetShape), np.int64)
            self._add("Reshape", [*names, self._tensor(f"{layer.name}.shape", shape)], *outputs)
        elif kind == "batchedMatmul" and not (values.transposeA or values.transposeB):
            self._add("MatMul", names, *outputs)
        elif kind == "concat":
            self._add("Concat", names, *outputs, axis=1)
        elif kind == "transpose":
            self._add("Transpose", names, *outputs, perm=list(values.axes))
        elif kind == "unary" and values.type == values.EXP:
            self._add("Exp", names, *outputs)
        else:
            raise UnknownLayerError(f"the layer {layer.name} ({kind}) cannot be converted")

    def _convolution(self, name: str, values: Any, names: list[str], outputs: list[str]) -> None:
        edges = values.valid.paddingAmounts.borderAmounts
        begin, end = ([getattr(one, side) for one in edges] or [0, 0] for side in _SIDES)
        shape = (values.outputChannels, values.kernelChannels, *values.kernelSize)
        inputs = [*names, self._tensor(f"{name}.weight", _weights(values.weights).reshape(shape))]
        if values.hasBias:
            inputs.append(self._tensor(f"{name}.bias", _weights(values.bias)))
        self._add(
            "Conv",
            inputs,
            *outputs,
            kernel_shape=list(values.kernelSize),
            strides=list(values.stride) or [1, 1],
            dilations=list(values.dilationFactor) or [1, 1],
            pads=[*begin, *end],
            group=max(values.nGroups, 1),
        )

    def _add(self, kind: str, inputs: list[str], *outputs: str, **attributes: Any) -> None:
        from onnx import helper

        self._nodes.append(helper.make_node(kind, inputs, outputs, **attributes))

    def _tensor(self, name: str, values: Any) -> str:
        """Add a constant; returns its name."""
        from onnx import numpy_helper

        self._tensors.append(numpy_helper.from_array(np.asarray(values), name))
        return name


def _value(name: str, shape: tuple[int, ...]) -> Any:
    from onnx import TensorProto, helper

    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def _weights(values: Any) -> Any:
    """Weights in single precision, stored in single or half precision."""
    if values.floatValue:
        return np.array(values.floatValue, np.float32)
    return np.frombuffer(values.float16Value, np.float16).astype(np.float32)


def main(arguments: list[str] | None = None) -> int:
    """Convert the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clone", type=Path, help="a clone of PinataFarms/FEARTracker")
    parser.add_argument("folder", type=Path, help="folder for the ONNX files; made if needed")
    options = parser.parse_args(arguments)
    try:
        import onnx
        from coremltools.proto import Model_pb2
    except ModuleNotFoundError as error:
        parser.error(f"{error}; pip install coremltools onnx")
    options.folder.mkdir(parents=True, exist_ok=True)
    source = options.clone / _SOURCE
    if not source.is_file():
        parser.error(f"{source} is missing; {options.clone} is no clone of FEARTracker")
    specification = Model_pb2.Model()
    specification.ParseFromString(source.read_bytes())
    for one in _CONVERSIONS:
        try:
            model = Converter(specification).convert(one.side, one.until)
        except UnknownLayerError as error:
            parser.error(f"{source}: {error}")
        onnx.save(model, str(options.folder / one.target))
        print(options.folder / one.target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
