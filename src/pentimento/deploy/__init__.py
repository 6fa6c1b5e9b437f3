"""From trained models to what a robot carries: graphs with their gradients, compared with PyTorch, and the bundle."""
