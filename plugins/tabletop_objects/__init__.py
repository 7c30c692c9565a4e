"""A table with scanned objects: any folder of textured meshes, with instructions that use their names."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from gvla2 import Component, hookimpl
from gvla2.robot.options import TaskConfig

if TYPE_CHECKING:
    from gvla2.robot.task import Task


@dataclass
class ObjectsConfig:
    """The meshes and their poses.

    ``root`` is a folder of meshes: ``mug.glb``, ``mug.obj`` or ``mug/textured.obj`` is the object "mug". ``names`` are
    the candidates, all by default; ``count`` of them are placed, 1 to 8, by default all of ``names`` or one of the
    folder.
    ``scale`` is metres per unit of the files (by default metres, or millimetres if only that makes sense), ``mass``
    kilograms (by default by size), ``pose`` is "upright", as in the files, or "fallen", as if dropped.
    """

    root: str = ""
    names: list[str] = field(default_factory=list)
    count: int | None = None
    scale: float | None = None
    mass: float | None = None
    friction: float = 0.8
    pose: str = "upright"


@dataclass
class TabletopObjectsConfig(TaskConfig):
    """Options of ``tabletop_objects``. ``ask`` is the kind of instruction: lift or put_in."""

    required: ClassVar[tuple[str, ...]] = ("objects.root",)

    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    ask: str = "lift"

    @property
    def known_objects(self) -> str:
        """The folder of the meshes; none where a scale is given, which galleries do not have."""
        return self.objects.root if self.objects.scale is None else ""


def _build(config: TabletopObjectsConfig) -> Task:
    """Lift or place scanned objects, called by their names."""
    from gvla2_plugins.tabletop_objects.task import TabletopObjects

    return TabletopObjects(config)


@hookimpl
def gvla2_tasks() -> list[Component[Task]]:
    """The task ``tabletop_objects``."""
    return [Component("tabletop_objects", TabletopObjectsConfig, _build)]
