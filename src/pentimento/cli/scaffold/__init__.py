"""`pentimento new`: a brush or a material is set up beside those that are there, in every file that names them."""
