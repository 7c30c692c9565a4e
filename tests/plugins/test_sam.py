import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.views import Views
from gvla2.perception.clicks import Segments
from gvla2.perception.options import VisionOptions
from gvla2.testing import check_perceiver, inputs
from gvla2_plugins.sam import SamConfig
from gvla2_plugins.sam.models import model_files
from gvla2_plugins.sam.perceiver import SamPerceiver
from tests.local_model import LocalModel, said


class ByColour:
    """A segmenter without weights: all of the box that has the colour of the clicked pixel."""

    def __init__(self, score=0.9):
        self.encodes = self.prompts = 0
        self.score = score

    def encode(self, image):
        self.encodes += 1
        self.image = image.astype(float)
        return self.segment

    def segment(self, prompts):
        self.prompts += len(prompts)
        size = self.image.shape[:2]
        rows, columns = np.indices(size) + 0.5
        masks = np.zeros((len(prompts), 1, *size), dtype=bool)
        for k, prompt in enumerate(prompts if self.score else ()):
            u, v = prompt.points[0].astype(int)
            left, top, right, bottom = prompt.box or (0, 0, size[1], size[0])
            box = (columns > left - 2) & (columns < right + 2) & (rows > top - 2) & (rows < bottom + 2)
            masks[k, 0] = box & (np.linalg.norm(self.image - self.image[v, u], axis=-1) < 120)
        return Segments(masks, np.full((len(prompts), 1), self.score))


@pytest.fixture
def perceiver():
    return SamPerceiver(SamConfig(name="sam"), ByColour())


def test_it_conforms(perceiver):
    check_perceiver(perceiver)


def test_one_prompt_an_object_and_picture_and_no_more_encodes_than_pictures(perceiver):
    scene = perceiver.perceive(inputs.observation(), "", inputs.WORKSPACE)
    assert [o.label for o in scene.objects] == ["red cube", "blue cube"]
    assert 1 <= perceiver._segmenter.encodes <= 3
    assert 4 <= perceiver._segmenter.prompts <= 6
    assert scene["o1"].extents == pytest.approx([0.052] * 3, abs=0.006)


def test_a_table_without_anything_is_an_empty_scene_and_costs_no_encode(perceiver):
    seen = inputs.observation(64)
    views = []
    for view in seen.views:
        origin, rays = view.camera.rays()
        flat = ((inputs.TABLE - origin[2]) / rays[..., 2]).astype(np.float32)
        views.append(replace(view, depth=np.where(flat > 0, flat, np.nan).astype(np.float32)))
    scene = perceiver.perceive(replace(seen, views=Views(tuple(views))), "", inputs.WORKSPACE)
    assert scene.objects == ()
    assert perceiver._segmenter.encodes == 0


def test_where_the_model_is_unsure_geometry_draws_the_outline():
    unsure = SamPerceiver(SamConfig(name="sam"), ByColour(score=0.0))
    assert len(unsure.perceive(inputs.observation(), "", inputs.WORKSPACE).objects) == 2


def test_clicks_find_what_the_instruction_means():
    seen = inputs.observation()

    def answer(request):
        return said(json.dumps({"done": len(model.requests) > 1, "x": x, "y": y}))

    camera = seen.views[0].camera
    centre = inputs.BLUE.world_from_block[:3, 3] + [0, 0, 0.5 * inputs.BLUE.side]
    x, y = 1000 * camera.project(centre[None])[0][0] / [camera.width, camera.height]
    with LocalModel(answer) as model:
        config = SamConfig(name="sam", localize=True, vision=VisionOptions(base_url=model.url))
        scene = SamPerceiver(config, ByColour()).perceive(
            replace(seen, views=Views((seen.views[0],))), "lift the blue cube", inputs.WORKSPACE
        )
    blue = min(scene.objects, key=lambda o: np.linalg.norm(o.centre - inputs.BLUE.world_from_block[:3, 3]))
    assert any(note.startswith(f"{blue.id} is the target") for note in scene.notes)


@pytest.mark.parametrize(
    ("changes", "said_"),
    [
        ({"min_score": 1.5}, "min_score"),
        ({"localize": True}, "vision"),
        ({"gallery": "/nowhere"}, "no such folder"),
    ],
)
def test_options_that_cannot_be_are_named(changes, said_):
    with pytest.raises(ConfigurationError, match=said_):
        SamPerceiver(SamConfig(name="sam", **changes), ByColour())


def test_without_weights_the_error_says_where_to_get_them(tmp_path):
    with pytest.raises(MissingDependencyError, match="scripts/fetch_sam"):
        SamPerceiver(SamConfig(name="sam"))
    (tmp_path / "a_encoder.onnx").write_bytes(b"")
    with pytest.raises(MissingDependencyError, match=r"a_encoder\.onnx"):
        model_files(str(tmp_path))


def test_weights_of_another_kind_are_refused(tmp_path):
    pytest.importorskip("onnxruntime")
    for name in ("encoder.onnx", "decoder.onnx"):
        (tmp_path / name).write_bytes(b"other weights")
    with pytest.raises(ConfigurationError, match="Cannot read a model for ONNX Runtime"):
        SamPerceiver(SamConfig(name="sam", weights=str(tmp_path)))
