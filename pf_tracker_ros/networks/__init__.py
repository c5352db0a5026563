"""Small networks in the ONNX format, which tell targets apart."""
