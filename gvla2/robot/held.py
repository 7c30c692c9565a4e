"""The executor's model of the scene while objects are carried: pure bookkeeping, no sensing."""

from __future__ import annotations

from dataclasses import replace

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Attachment
from gvla2.planning.scene import Scene, SceneObject


class CarriedScene:
    """A scene in which at most one object is attached to the hand.

    Parts of the carried object (those whose ``parent`` it is) move with it. ``scene`` is the hand's surroundings;
    ``attached`` is the carried object, or None.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.attached: Attachment | None = None
        self._parts: tuple[SceneObject, ...] = ()
        self._grasped_at: FloatArray | None = None

    def carry(self, object_id: str, world_from_tcp: FloatArray) -> None:
        """Attach the object to the hand at the tool pose (4, 4) at which the fingers closed."""
        if self.attached is not None and self.attached.object.id == object_id:
            return
        self.release(world_from_tcp)
        thing = self.scene[object_id]
        self._grasped_at = world_from_tcp
        self._parts = tuple(o for o in self.scene.objects if o.parent == object_id)
        rest = tuple(o for o in self.scene.objects if o.id != object_id and o.parent != object_id)
        self.scene = replace(self.scene, objects=rest)
        self.attached = Attachment(thing, invert_rigid(world_from_tcp) @ thing.world_from_object)

    def release(self, world_from_tcp: FloatArray) -> None:
        """Release the carried object where the tool pose (4, 4) leaves it."""
        if self.attached is None or self._grasped_at is None:
            return
        moved = world_from_tcp @ invert_rigid(self._grasped_at)
        left = tuple(
            replace(
                thing,
                world_from_object=moved @ thing.world_from_object,
                points=transform_points(moved, thing.points),
                known=None
                if thing.known is None
                else replace(thing.known, world_from_scan=moved @ thing.known.world_from_scan),
            )
            for thing in (self.attached.object, *self._parts)
        )
        self.scene = replace(self.scene, objects=self.scene.objects + left)
        self.attached, self._parts, self._grasped_at = None, (), None
