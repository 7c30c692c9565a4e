"""Asking an untrusted perceiver, and checking that its answer is a scene of finite numbers."""

from __future__ import annotations

from math import isfinite
from numbers import Real

from gvla2.errors import ConformanceError, PerceptionError
from gvla2.geometry.readonly import read_only
from gvla2.geometry.requirements import require, require_array, require_rigid, require_type
from gvla2.geometry.views import Observation
from gvla2.planning.contracts import Perceiver
from gvla2.planning.scene import Box, Scene, SceneObject


def perceive(
    perceiver: Perceiver, observation: Observation, instruction: str, workspace: Box, who: str
) -> Scene:
    """The perceiver's scene, its arrays read-only, as are those that it is given.

    Raises :class:`PerceptionError` when nothing is seen, and for an answer that is no scene; ``who`` begins the
    sentence then: "The perceiver 'mine' of plugin 'yours'".
    """
    scene = perceiver.perceive(read_only(observation), instruction, read_only(workspace))
    try:
        check_scene(scene)
    except ConformanceError as error:
        raise PerceptionError(f"{who} gave no valid scene. {error}") from error
    return read_only(scene)


def check_scene(scene: object) -> None:
    """Whether this is a scene whose objects have ids of their own, rigid poses and finite sizes and points.

    Raises :class:`ConformanceError`, which says what is not so.
    """
    require_type(scene, Scene, "perceive()'s answer")
    assert isinstance(scene, Scene)
    require_type(scene.objects, tuple, "The scene's objects")
    height: object = scene.table_height
    require(
        isinstance(height, Real) and isfinite(height), f"table_height must be finite, got {height!r:.80}."
    )
    for thing in scene.objects:
        require_type(thing, SceneObject, "An object of the scene")
        what = f"Object '{thing.id}'"
        require_rigid(thing.world_from_object, f"{what}: world_from_object")
        extents = require_array(thing.extents, (3,), f"{what}: extents")
        require((extents >= 0).all(), f"{what}: extents must not be negative, got {extents}.")
        require_array(thing.points, (None, 3), f"{what}: points")
    ids = [thing.id for thing in scene.objects]
    require(all(ids) and len(set(ids)) == len(ids), f"Ids of objects must be unique, got {ids}.")
