import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.commands.run import run_episodes
from gvla2.episode.record import EpisodeRecord
from gvla2.episode.refine import (
    ABOVE_SUPPORT,
    GeometryComponents,
    masked_views,
    objects_of_interest,
    refine_scene,
    with_truth,
)
from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid
from gvla2.geometry.view_folders import read_views
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.plugins.assembly import build_components
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.record.recorder import RunRecorder
from gvla2_plugins.axes import ContoursConfig
from gvla2_plugins.axes.compensations import Contours
from gvla2_plugins.geofuse.fusions import Residual
from gvla2_plugins.nothing import NoPrior
from tests.quick import QUICK

SIZE = np.array([0.06, 0.04, 0.05])
POSE = rigid(translation=(0.3, 0.1, 0.025))


def box_mesh(size):
    import trimesh

    mesh = trimesh.creation.box(extents=size)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


@pytest.fixture(scope="module")
def observation():
    vertices, faces = box_mesh(SIZE)
    board, sides = box_mesh(np.array([4.0, 4.0, 0.02]))
    table = Surface(board - [0.0, 0.0, 0.01], sides, np.array([0.5, 0.5, 0.5]), 1)
    caster = RayCaster([Surface(vertices, faces, np.array([0.8, 0.1, 0.1]), 0), table])
    cameras = [
        Camera.from_fov(0.7, look_along(position, np.array([0.3, 0.1, 0.0]) - position), 96, 96, name)
        for name, position in (("left", np.array([0.3, 0.7, 0.6])), ("front", np.array([1.0, 0.1, 0.5])))
    ]
    images = caster.cast(cameras, {0: POSE, 1: np.eye(4)})
    views = tuple(View(c, i.image, i.depth) for c, i in zip(cameras, images, strict=True))
    return Observation(Views(views), np.eye(4), np.zeros(7), 1.0, 0.08)


def scene_of(extents):
    seen = SceneObject("o1", "red box", "box", "red", POSE, np.asarray(extents), np.zeros((1, 3)))
    patch = SceneObject("o2", "blue square", "region", "blue", np.eye(4), np.ones(3) * 0.1, np.zeros((1, 3)))
    return Scene((seen, patch), 0.0, Box(np.full(3, -2.0), np.full(3, 2.0)))


class Watched:
    """The hull reconstructor, noting what it is shown."""

    def __init__(self):
        self.seen = []

    def reconstruct(self, views):
        self.seen.append(views)
        return carve(views).to_reconstruction()


def parts(reconstructor):
    return GeometryComponents(
        reconstructor,
        NoPrior(),
        Contours(ContoursConfig(name="contours")),
        Residual(0.5),
        Rasteriser(),
    )


def test_masks_are_the_silhouette(observation):
    views = masked_views(observation, scene_of(SIZE).objects[0])
    assert views is not None
    for view in views:
        # All that is seen of it but a hem of 3 mm above what it stands on.
        above = view.points()[..., 2] > POSE[2, 3] - SIZE[2] / 2 + ABOVE_SUPPORT
        np.testing.assert_array_equal(view.mask > 0.5, above)


def test_a_box_is_refined_only_where_the_masks_speak_for_it(observation):
    watched = Watched()
    for wrong in (1.6, 0.7):
        perceived = scene_of(SIZE * [wrong, wrong, 1.0])
        scene, (one,) = refine_scene(perceived, observation, "lift it", parts(watched))
        assert one.used
        np.testing.assert_allclose(scene["o1"].extents, SIZE, atol=6e-3)
        np.testing.assert_array_equal(scene["o2"].extents, np.full(3, 0.1))
    assert len(watched.seen) == 2
    scene, (one,) = refine_scene(scene_of(SIZE), observation, "lift it", parts(watched))
    assert not one.used
    assert one.after is not None
    np.testing.assert_array_equal(scene["o1"].extents, SIZE)
    assert one.to_json()["before"] == SIZE.tolist()
    (judged,) = with_truth((one,), scene_of(SIZE * 0.9))
    assert judged.width_error == pytest.approx(0.1 * SIZE[1])


def test_pixels_without_a_measurement_say_nothing(observation):
    """A hole in the depth must not become a hole in the object."""
    holes = np.random.default_rng(0).random((96, 96)) < 0.3
    views = [replace(view, depth=np.where(holes, np.nan, view.depth)) for view in observation.views]
    lossy = replace(observation, views=Views(tuple(views)))
    for seen in (observation, lossy):
        _, (one,) = refine_scene(scene_of(SIZE), seen, "lift it", parts(Watched()))
        assert (one.after.extents > SIZE - 4e-3).all()


def test_a_run_passes_the_branchs_options(registry, compose_run, tmp_path):
    extents = []
    for name, overrides in (
        ("default", ()),
        ("shrunk", ("branch=paper", "branch.tau=1", "branch.lambda_max=.5")),
    ):
        cameras = ("robot.image_size=96", "robot.cameras=[front,left_shoulder]")
        config = compose_run(*QUICK, *cameras, "memory=none", "reconstructor=hull", *overrides)
        (record,) = run_episodes(config, registry, tmp_path / name)
        extents.append(np.array([each.after.extents for each in record.refined]))
        assert all(each.true is not None for each in record.refined)
        kept = json.loads((tmp_path / name / "result.json").read_text())["refined"]
        assert [each["after"] for each in kept] == extents[-1].tolist()
    assert (extents[1] < extents[0] - 5e-3).any()


@pytest.mark.parametrize("unused", ["fusion=blend", "axis.iterations=3", "prior=depth", "branch.tau=.3"])
def test_options_that_no_reconstructor_uses_are_refused(registry, compose_run, unused):
    with pytest.raises(ConfigurationError, match="without a reconstructor nothing uses this"):
        build_components(config := compose_run(*QUICK, unused), registry, branch=config.branch)


@pytest.mark.parametrize(
    ("given", "stage"),
    [("fusion=blend", "fusion"), ("branch.tau=.3", "soft_hull"), ("branch.eta=.2", "soft_hull")],
)
def test_options_of_a_stage_that_is_off_are_refused_with_the_switch(registry, compose_run, given, stage):
    with pytest.raises(ConfigurationError, match=f"Add branch.{stage}=true"):
        build_components(
            config := compose_run(*QUICK, "reconstructor=hull", given), registry, branch=config.branch
        )


def test_the_objects_of_interest_are_those_that_are_named():
    red, green = (
        SceneObject(f"o{i}", f"{colour} {noun}", "box", colour, POSE, SIZE, np.zeros((1, 3)))
        for i, (colour, noun) in enumerate((("red", "cube"), ("green", "cup")))
    )
    scene = Scene((red, green), 0.0, Box(np.full(3, -2.0), np.full(3, 2.0)))
    for sentence, named in (("Lift the RED cube", ["o0"]), ("the cup, please", ["o1"]), ("go", ["o0", "o1"])):
        assert [obj.id for obj in objects_of_interest(scene, sentence)] == named


def test_a_run_keeps_the_views_of_the_named_object(observation, tmp_path):
    record = EpisodeRecord(
        "one", "lift the red box", "", 0, choices={}, observation=observation, scene=scene_of(SIZE)
    )
    recorder = RunRecorder(tmp_path, "seed: 0\n")
    recorder.stage(record, "perceive")
    recorder.settle()
    kept, expected = read_views(tmp_path), masked_views(observation, scene_of(SIZE).objects[0])
    assert [view.name for view in kept] == [view.name for view in expected]
    for ours, theirs in zip(kept, expected, strict=True):
        np.testing.assert_array_equal(ours.mask, theirs.mask)
        np.testing.assert_array_equal(ours.depth, theirs.depth)
