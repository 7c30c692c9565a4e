"""Bodies that are meshes: any textured .obj, .glb or .ply file on the table."""

from __future__ import annotations

import os
from dataclasses import dataclass

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.scan import read_scan
from gvla2.robot.task import Body


@dataclass(frozen=True)
class Mesh:
    """A file and its thing's physics: ``scale`` metres per unit of the file (None: metres, or millimetres if only that
    makes sense), ``mass`` in kilograms, ``friction`` against other things.

    >>> mug = Mesh("scans/mug.glb", mass=0.12).body("mug", world_from_body)
    >>> Layout((mug, *others))
    """

    path: str | os.PathLike[str]
    scale: float | None = None
    mass: float = 0.1
    friction: float = 0.8

    def body(
        self, name: str, world_from_body: FloatArray, *, label: str = "", fixed: bool = False, shape: str = ""
    ) -> Body:
        """The body whose frame is the middle of the mesh's bounding box, at ``world_from_body`` (4, 4).

        Raises as :func:`gvla2.robot.scan.read_scan` does, and :class:`ConfigurationError` for an impossible mass or
        friction.
        """
        if not (self.mass > 0 and self.friction >= 0):
            raise ConfigurationError(
                f"{self.path}: a thing has a mass above 0 and a friction of at least 0, got mass={self.mass}, "
                f"friction={self.friction}."
            )
        scan = read_scan(self.path, self.scale)
        return Body(
            name,
            (scan,),
            world_from_body,
            self.mass,
            fixed,
            self.friction,
            label or name,
            shape or scan_shape(scan.size),
        )


def scan_shape(size: tuple[float, float, float]) -> str:
    """A mesh's :data:`gvla2.planning.scene.Shape` by its sides alone: long things are bars, the rest is "other"."""
    short, middle, long = sorted(size)
    return "bar" if long > 3.0 * middle and short > 0 else "other"
