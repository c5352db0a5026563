"""Small networks in the ONNX format, as those that tell targets apart."""
