"""GeoFuse-MV3D: object geometry from calibrated views.

The whole branch is :func:`gvla2.reconstruction.branch.refine_geometry`; of its pieces,
:func:`gvla2.reconstruction.support.mask_support` and :func:`gvla2.reconstruction.support.soft_hull` stand alone.
"""
