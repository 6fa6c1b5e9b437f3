"""What execution needs: one checked folder, its graphs in onnxruntime, tokenizer and sampler."""
