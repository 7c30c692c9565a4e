"""Cameras, views, Gaussians, meshes and their file formats: the lowest layer.

Conventions, everywhere: metres, right-handed frames, OpenCV cameras (x right, y down, z forward), pixel
(row i, column j) covers [j, j+1) x [i, i+1) so that its centre is (j + 0.5, i + 0.5), depth is the z of the
camera frame and NaN where nothing was measured, ``b_from_a`` is the 4x4 matrix that takes points of a to b.
"""
