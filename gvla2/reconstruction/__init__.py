"""GeoFuse-MV3D: object geometry from calibrated views.

:func:`mask_support` and :func:`soft_hull` are there for those who want the pieces; the whole branch is
:func:`gvla2.reconstruction.branch.refine_geometry`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gvla2.reconstruction.support import mask_support
    from gvla2.reconstruction.visual_hull import soft_hull

__all__ = ["mask_support", "soft_hull"]


def __getattr__(name: str) -> Any:
    # Looked up when asked for: they bring the compiler of their loops, which a reader of contracts does not need.
    if name == "mask_support":
        from gvla2.reconstruction.support import mask_support

        return mask_support
    if name == "soft_hull":
        from gvla2.reconstruction.visual_hull import soft_hull

        return soft_hull
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
