"""Export of trained models to ONNX graphs and a bundle that runs without PyTorch."""
