"""Small networks in the ONNX format, which compare a box of a frame with a target."""
