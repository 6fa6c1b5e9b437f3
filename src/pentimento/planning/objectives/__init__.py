"""What a painting should be like: each objective turns an image [H, W, 3] in linear light into a scalar to lower."""
