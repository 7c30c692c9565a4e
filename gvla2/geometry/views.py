"""RGB-D views of one moment, and what a robot observes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray

Viewpoint = Literal["robot", "facing"]
"""Where the person stands who says left, right, in front and behind: beside the robot, looking where it looks, or
opposite, facing it."""


@dataclass(frozen=True)
class View:
    """One calibrated image.

    ``image`` (H, W, 3) uint8 RGB; ``depth`` (H, W) float32, metres along the camera's z, NaN where nothing
    was measured, or None for a colour camera; ``mask`` (H, W) float32 in [0, 1], the object's silhouette
    where one is known; ``robot_mask`` (H, W) bool, pixels that the robot's own model explains by its measured
    joints (forward kinematics, so it is known on a real robot too).
    Raises :class:`GeometryError` when a size differs from the camera's.
    """

    camera: Camera
    image: NDArray[np.uint8]
    depth: NDArray[np.float32] | None = None
    mask: NDArray[np.float32] | None = None
    robot_mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        if self.image.shape != (*size, 3):
            raise GeometryError(
                f"View '{self.name}': the image has shape {self.image.shape}, the camera says {(*size, 3)}."
            )
        for what in ("depth", "mask", "robot_mask"):
            array = getattr(self, what)
            if array is not None and array.shape != size:
                raise GeometryError(f"View '{self.name}': {what} has shape {array.shape}, expected {size}.")

    @property
    def name(self) -> str:
        """The camera's name."""
        return self.camera.name

    def points(self) -> FloatArray:
        """(H, W, 3) world points of the depth map, NaN where there is none."""
        if self.depth is None:
            raise GeometryError(f"View '{self.name}' has no depth.")
        return self.camera.backproject(self.depth.astype(np.float64))


@dataclass(frozen=True)
class Views:
    """The input views D = {(I_i, M_i, K_i, T_i)} of the paper; at least one."""

    views: tuple[View, ...]

    def __post_init__(self) -> None:
        if not self.views:
            raise GeometryError("No views: at least one calibrated image is needed.")

    def __iter__(self) -> Iterator[View]:
        return iter(self.views)

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, index: int) -> View:
        return self.views[index]


@dataclass(frozen=True)
class Observation:
    """What a robot knows at one moment: its cameras' views and its own measured hand.

    ``world_from_tcp`` (4, 4) is the tool centre point between the fingertips (z out of the hand, y along the fingers'
    motion); ``joints`` (dof,) in radians; ``gripper`` is the opening in [0, 1]; ``gripper_width`` the same in metres.
    Nothing here comes from a simulator's state of the scene. ``finer``, where a simulator offers it, takes the same
    moment's picture by the camera of a name with more pixels, for people and for reading text: see :meth:`pictured`.
    ``viewpoint`` is where the person stands whose words for sides are heard.
    """

    views: Views
    world_from_tcp: FloatArray
    joints: FloatArray
    gripper: float
    gripper_width: float
    finer: Callable[[str], View] | None = field(default=None, repr=False, compare=False)
    viewpoint: Viewpoint = "robot"

    def pictured(self) -> Views:
        """The views with the most pixels: the finer ones if available, at the cameras' believed poses."""
        return Views(tuple(map(self.shown, self.views)))

    def shown(self, view: View) -> View:
        """One of the views, as :meth:`pictured` has it."""
        if self.finer is None:
            return view
        fine = self.finer(view.name)
        return replace(fine, camera=replace(fine.camera, world_from_camera=view.camera.world_from_camera))
