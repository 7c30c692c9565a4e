"""The box with a hinged lid, to be opened or closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.placing import inside, sample_root
from gvla2.robot.solids import tray
from gvla2.robot.task import Body, Joint, Primitive, TaskSite

BOX, WALL = (0.25, 0.35, 0.15), 0.01
LID, LID_MASS = (0.268, 0.35, 0.01), 0.938
HINGE_RANGE = (-0.253, 2.365)
"""Metres, kilograms; radians from closed to opened as published: our travel counts from where the lid starts."""

TRAVEL = HINGE_RANGE[1] - HINGE_RANGE[0]
YAW = np.pi / 8

HOOK_BEHIND, HOOK_BELOW = 0.018, 0.012
"""Where a hooking tool's centre point is behind and below the lid's edge, metres: half a finger off it."""


@dataclass(frozen=True)
class LidBox:
    """A box about ``root`` (4, 4), its hinge at +x, its lip at -x; ``scale`` times the published size."""

    root: FloatArray
    scale: float

    @property
    def hinge(self) -> FloatArray:
        """(3,) middle of the hinge, world."""
        k = self.scale
        point = self.root @ np.array([k * BOX[0] / 2, 0.0, k * BOX[2] + LID[2] / 2, 1.0])
        return np.asarray(point[:3])

    def lid_pose(self, angle: float) -> FloatArray:
        """world_from_lid (4, 4) when the lid is open by ``angle`` radians; its origin is its middle."""
        turn = rigid(self.root[:3, :3] @ Rotation.from_euler("y", angle).as_matrix(), self.hinge)
        return turn @ rigid(translation=(-self.scale * LID[0] / 2, 0.0, 0.0))

    def along_lid(self, angle: float, distance: float) -> FloatArray:
        """(3,) the point of the lid's middle line ``distance`` metres from the hinge, open by ``angle``."""
        pose = self.lid_pose(angle)
        return np.asarray(self.hinge - pose[:3, 0] * distance)

    def bodies(
        self, angle: float, colours: tuple[tuple[float, float, float], tuple[float, float, float]], words: str
    ) -> tuple[Body, Body]:
        """Box and lid, the lid open by ``angle``; ``colours`` of the two, ``words`` for the box's label."""
        k = self.scale
        outer = (k * BOX[0], k * BOX[1], k * BOX[2])
        lid = Primitive("box", (k * LID[0], k * LID[1], LID[2]), colours[1])
        return (
            Body("box", tray(outer, WALL, colours[0]), self.root, 2.0, fixed=True, label=words, shape="box"),
            Body("lid", (lid,), self.lid_pose(angle), LID_MASS, label="box lid", shape="plate"),
        )

    def joint(self, *, opens: bool) -> Joint:
        """The hinge: travel counts from closed when it ``opens``, else from opened."""
        return Joint(
            "hinge",
            "revolute",
            "box",
            "lid",
            axis=self.root[:3, 1] * (1.0 if opens else -1.0),
            origin=self.hinge,
            limits=(0.0, TRAVEL),
            damping=0.1,
            friction=0.02,
        )


def draw_box(rng: np.random.Generator, site: TaskSite, scale: float) -> LidBox | None:
    """A box inside the site, its back away from the robot; None when it is out of place."""
    root = sample_root(rng, site, YAW)
    box = LidBox(root, scale)
    corners = [
        root[:3, :3] @ (scale * np.array([x, y, 0]) / 2) for x in (-BOX[0], BOX[0]) for y in (-BOX[1], BOX[1])
    ]
    if not all(inside(site, (root[:3, 3] + corner)[:2], 0.0) for corner in corners):
        return None
    return box


HOOK_LEANS = (0.0, 0.35)
"""How far the fingertips may lean away from the box when they hook behind its lid, radians."""


LARGE = 1.05
"""The edge of a lid larger by this is out of reach of a hand pointing down."""

BESIDE, INTO = 0.6, 0.025
"""How far out along the lid fingers push it from beside, as a share of its length; how far they reach behind it."""


def shut_paths(box: LidBox, angles: FloatArray) -> list[list[FloatArray]]:
    """Ways to shut the lid through ``angles`` (N,), tool poses (4, 4) each: before, behind the lid, and over.

    A hook behind its edge from above, the hand either way round; for a large lid also with the hand leaning, or level
    beside the lid with the fingers behind it.
    """
    back, up = box.root[:3, 0], np.array([0.0, 0.0, 1.0])
    large = box.scale > LARGE
    ways = []
    for lean in HOOK_LEANS if large else HOOK_LEANS[:1]:
        for sign in (1.0, -1.0):
            path = hook_path(box, angles, sign, lean)
            behind = rigid(translation=0.03 * back) @ path[0]
            ways.append([rigid(translation=0.05 * up) @ behind, behind, *path])
    for side in (1.0, -1.0) if large else ():
        for closing in (up, -up, back, -back):
            path = beside_path(box, angles, side, closing)
            behind = rigid(translation=0.02 * box.lid_pose(float(angles[0]))[:3, 2]) @ path[0]
            ways.append([behind @ rigid(translation=(0.0, 0.0, -0.085)), behind, *path])
    return ways


def beside_path(box: LidBox, angles: FloatArray, side: float, closing: FloatArray) -> list[FloatArray]:
    """Tool poses (4, 4) of a level hand beside the lid whose fingers are behind it at ``angles`` (N,)."""
    axis = box.root[:3, 1]
    turned = grasp_rotation(-side * axis, closing)
    rim = side * (box.scale * LID[1] / 2 - INTO) * axis
    spots = [
        box.along_lid(float(angle), BESIDE * box.scale * LID[0])
        + HOOK_BEHIND * box.lid_pose(float(angle))[:3, 2]
        for angle in angles
    ]
    return [rigid(turned, spot + rim) for spot in spots]


def lip_path(box: LidBox, angles: FloatArray, beyond: float, sign: float) -> list[FloatArray]:
    """Tool poses (4, 4) of a hand that holds the lip at ``angles`` (N,), pointing to the hinge along the lid.

    The tool centre point is ``beyond`` metres inside the lip's edge; ``sign`` turns the hand over.
    """
    poses = []
    for angle in angles:
        lid = box.lid_pose(float(angle))
        at = box.along_lid(float(angle), box.scale * LID[0] - beyond)
        poses.append(rigid(grasp_rotation(lid[:3, 0], sign * lid[:3, 2]), at))
    return poses


def hook_path(box: LidBox, angles: FloatArray, sign: float, lean: float = 0.0) -> list[FloatArray]:
    """Tool poses (4, 4) of a hand that points down and hooks behind the lid's edge at ``angles`` (N,).

    The fingertips lean away from the box by ``lean`` radians: an edge further off is then in reach.
    """
    down, back = np.array([0.0, 0.0, -1.0]), box.root[:3, 0]
    approach = np.cos(lean) * down + np.sin(lean) * back
    behind = np.cos(lean) * back - np.sin(lean) * down
    turned = grasp_rotation(approach, sign * box.root[:3, 1])
    edges = [box.along_lid(float(angle), box.scale * LID[0]) for angle in angles]
    below = HOOK_BELOW * (1.0 + 2.0 * np.sin(lean))  # a leaning finger slips off sooner
    return [rigid(turned, edge + HOOK_BEHIND * behind + below * approach) for edge in edges]
