"""Goals for sculpting: reliefs from letters, shapes, height maps, meshes and pictures (thesis 7.3.5, 7.4.2).

A relief is float64 [H, W]. Row 0 is the top, up is positive, the unit is arbitrary: ``planning.pushes.goal`` scales it
to the clay.
"""
