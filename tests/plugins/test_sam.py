import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError, PerceptionError
from gvla2.geometry.views import Views
from gvla2.perception.clicks import Prompt, Segments
from gvla2.perception.options import VisionOptions
from gvla2.testing import check_perceiver, inputs
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.sam import SamConfig
from gvla2_plugins.sam.models import model_files
from gvla2_plugins.sam.perceiver import SamPerceiver


class ByColour:
    """A segmenter without weights: all of the box that has the colour of the clicked pixel."""

    def __init__(self):
        self.encodes = self.prompts = 0

    def encode(self, image):
        self.encodes += 1
        return _Picture(self, image.astype(float))


class _Picture:
    def __init__(self, model, image):
        self.model, self.image = model, image

    def segment(self, prompts):
        self.model.prompts += len(prompts)
        size = self.image.shape[:2]
        rows, columns = np.indices(size) + 0.5
        logits = np.full((len(prompts), 1, *size), -5.0, dtype=np.float32)
        for k, prompt in enumerate(prompts):
            u, v = prompt.points[0].astype(int)
            left, top, right, bottom = prompt.box or (0, 0, size[1], size[0])
            box = (columns > left - 2) & (columns < right + 2) & (rows > top - 2) & (rows < bottom + 2)
            logits[k, 0][box & (np.linalg.norm(self.image - self.image[v, u], axis=-1) < 120)] = 5.0
        return Segments(logits, np.full((len(prompts), 1), 0.9))


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


def test_all_depth_missing_from_one_camera_leaves_the_others(perceiver):
    seen = inputs.observation()
    views = [replace(v, depth=None) if i == 1 else v for i, v in enumerate(seen.views)]
    scene = perceiver.perceive(replace(seen, views=Views(tuple(views))), "", inputs.WORKSPACE)
    assert len(scene.objects) == 2
    assert "camera_1" in scene.notes[0]
    with pytest.raises(PerceptionError, match="No view"):
        perceiver.perceive(
            replace(seen, views=Views(tuple(replace(v, depth=None) for v in views))), "", inputs.WORKSPACE
        )


def test_where_the_model_is_unsure_geometry_draws_the_outline():
    class Unsure(ByColour):
        def encode(self, image):
            self.encodes += 1
            return _Nothing(image.shape[:2])

    class _Nothing:
        def __init__(self, size):
            self.size = size

        def segment(self, prompts):
            return Segments(
                np.full((len(prompts), 1, *self.size), -5.0, np.float32), np.zeros((len(prompts), 1))
            )

    scene = SamPerceiver(SamConfig(name="sam"), Unsure()).perceive(inputs.observation(), "", inputs.WORKSPACE)
    assert len(scene.objects) == 2


def test_clicks_find_what_the_instruction_means():
    seen = inputs.observation()

    def answer(request):
        return said(json.dumps({"done": len(model.requests) > 1, "x": x, "y": y, "on": True}))

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
        ({"model": "sam9"}, "must be one of"),
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
    with pytest.raises(MissingDependencyError, match="mobile_sam"):
        SamPerceiver(SamConfig(name="sam", model="mobile_sam", weights=str(tmp_path / "no.pt")))


def test_weights_of_another_hash_or_kind_are_refused(tmp_path):
    for name in ("encoder.onnx", "decoder.onnx"):
        (tmp_path / name).write_bytes(b"other weights")
    with pytest.raises(ConfigurationError, match="SHA-256"):
        SamPerceiver(SamConfig(name="sam", weights=str(tmp_path), sha256={"encoder.onnx": "0" * 64}))
    pytest.importorskip("onnxruntime")
    with pytest.raises(ConfigurationError, match="no model that ONNX Runtime can load"):
        SamPerceiver(SamConfig(name="sam", weights=str(tmp_path)))


def test_a_checkpoint_goes_through_kornias_own_model(tmp_path):
    """Tiny and random: the loading code and the prompts are real, the masks mean nothing."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("kornia")
    from kornia.models.sam import Sam
    from kornia.models.sam.architecture.common import LayerNorm
    from kornia.models.sam.architecture.image_encoder import ImageEncoderViT
    from kornia.models.sam.architecture.mask_decoder import MaskDecoder
    from kornia.models.sam.architecture.prompt_encoder import PromptEncoder
    from kornia.models.sam.architecture.transformer import TwoWayTransformer

    from gvla2_plugins.sam.models import SamByKornia, fill

    def tiny(width=16):
        torch.manual_seed(0)
        return Sam(
            ImageEncoderViT(
                img_size=64, patch_size=16, embed_dim=width, depth=1, num_heads=2, out_chans=16, qkv_bias=True,
                norm_layer=LayerNorm, use_rel_pos=True, window_size=2, global_attn_indexes=(0,),
            ),
            PromptEncoder(16, (4, 4), (64, 64), 4),
            MaskDecoder(
                transformer_dim=16, num_multimask_outputs=3, iou_head_depth=2, iou_head_hidden_dim=8,
                transformer=TwoWayTransformer(depth=1, embedding_dim=16, mlp_dim=16, num_heads=2),
            ),
        )  # fmt: skip

    made = tiny()
    torch.save(made.state_dict(), tmp_path / "tiny.pt")
    blank = tiny()
    for parameter in blank.parameters():
        torch.nn.init.zeros_(parameter)
    model = SamByKornia(fill(blank, tmp_path / "tiny.pt"), 64)
    image = np.random.default_rng(0).integers(0, 255, (48, 32, 3), dtype=np.uint8)
    prompts = [Prompt.click(10, 20), Prompt(np.array([[5.0, 5.0]]), np.array([True]), (2.0, 2.0, 20.0, 30.0))]
    answer = model.encode(image).segment(prompts)
    assert answer.logits.shape == (2, 3, 48, 32)
    assert answer.scores.shape == (2, 3)
    same = SamByKornia(made.eval(), 64).encode(image).segment(prompts)
    assert np.allclose(answer.logits, same.logits, atol=1e-5)
    assert model.encode(image).segment([]).logits.shape[0] == 0
    with pytest.raises(ConfigurationError, match="holds no weights of this model"):
        fill(tiny(32), tmp_path / "tiny.pt")
