"""Reliefs to sculpt: from letters, shapes, height maps, meshes, pictures and point clouds (thesis 7.3.5, 7.4.2).

A relief is float64 [H, W], row 0 is the top, up is more; its unit does not matter, for ``planning.pushes.goal`` fits
it to the clay at hand.
"""
