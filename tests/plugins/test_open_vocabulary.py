"""A tiny random checkpoint: loading, prompts and shapes are real, what is found means nothing."""

import json

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.testing import check_perceiver, inputs
from gvla2_plugins.open_vocabulary import VocabularyConfig
from gvla2_plugins.open_vocabulary.perceiver import MaskCandidate, VocabularyPerceiver, load_sam3, named_in


class Knows:
    """Finds colours in the picture by their names."""

    def __init__(self):
        self.asked = []

    def find(self, image, words, threshold):
        self.asked.append(words)
        found = []
        for word in words:
            channel = {"red": 0, "blue": 2}.get(word.split()[0])
            if channel is not None:
                rest = [c for c in range(3) if c != channel]
                mask = image[..., channel].astype(int) > image[..., rest].max(axis=-1).astype(int) + 60
                found.append(MaskCandidate(0, mask, 0.9, word))
        return found


def test_what_words_name_is_found_and_named():
    config = VocabularyConfig(name="sam3", words=["red block", "blue block", "green mug"])
    perceiver = VocabularyPerceiver(config, Knows())
    scene = perceiver.perceive(inputs.observation(), "", inputs.WORKSPACE)
    assert [o.label for o in scene.objects] == ["red block", "blue block"]
    assert scene.objects[0].centre == pytest.approx(inputs.RED.world_from_block[:3, 3], abs=0.008)
    check_perceiver(perceiver)


def test_without_words_the_instruction_names_them():
    knows = Knows()
    VocabularyPerceiver(VocabularyConfig(name="sam3"), knows).perceive(
        inputs.observation(), "put the red cube left of the blue cube", inputs.WORKSPACE
    )
    assert knows.asked[0] == ["red cube", "blue cube"]
    silent = VocabularyPerceiver(VocabularyConfig(name="sam3"), knows)
    assert "names nothing" in silent.perceive(inputs.observation(), "", inputs.WORKSPACE).notes[0]


@pytest.mark.parametrize(
    ("instruction", "names"),
    [
        ("Pick up the mustard bottle and put it in the bowl.", ["mustard bottle", "bowl"]),
        ("lift the red cube", ["red cube"]),
        ("", []),
    ],
)
def test_names_stand_between_verbs_and_prepositions(instruction, names):
    assert named_in(instruction) == names


def test_options_that_cannot_be():
    with pytest.raises(ConfigurationError, match="threshold"):
        VocabularyPerceiver(VocabularyConfig(name="sam3", threshold=0), Knows())


def test_weights_that_are_absent_or_another_model(tmp_path):
    pytest.importorskip("transformers")
    with pytest.raises(MissingDependencyError, match="facebook/sam3"):
        load_sam3("")
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    with pytest.raises(ConfigurationError, match="is a 'bert'"):
        load_sam3(str(tmp_path))
    (tmp_path / "config.json").write_text("{")
    with pytest.raises(ConfigurationError, match="Cannot read perceiver"):
        load_sam3(str(tmp_path))


@pytest.fixture
def tokenizer():
    transformers = pytest.importorskip("transformers")
    tokenizers = pytest.importorskip("tokenizers")
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", ".", "red", "cube", "?"]
    made = tokenizers.Tokenizer(
        tokenizers.models.WordLevel({w: i for i, w in enumerate(words)}, unk_token="[UNK]")
    )
    made.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    return transformers.PreTrainedTokenizerFast(
        tokenizer_object=made, pad_token="[PAD]", unk_token="[UNK]", cls_token="[CLS]", sep_token="[SEP]"
    )


IMAGE = np.random.default_rng(0).integers(0, 255, (40, 60, 3), dtype=np.uint8)


def test_sam3_loads_and_answers_at_the_pictures_size(tmp_path, tokenizer):
    import torch
    from transformers import Sam3Config, Sam3Model

    torch.manual_seed(0)
    small = {"hidden_size": 32, "intermediate_size": 32, "num_attention_heads": 4}
    config = Sam3Config(
        vision_config={
            "backbone_config": {
                "model_type": "sam3_vit_model", **small, "num_hidden_layers": 2, "image_size": 56, "patch_size": 14,
                "window_size": 2, "global_attn_indexes": [1], "pretrain_image_size": 56,
            },
            "fpn_hidden_size": 32, "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        },
        text_config={
            **small, "vocab_size": 8, "projection_dim": 16, "num_hidden_layers": 1, "max_position_embeddings": 8,
            "pad_token_id": 0, "bos_token_id": 2, "eos_token_id": 3,
        },
        geometry_encoder_config={**small, "num_layers": 1},
        detr_encoder_config={**small, "num_layers": 1},
        detr_decoder_config={**small, "num_layers": 1, "num_queries": 5},
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 4},
    )  # fmt: skip
    Sam3Model(config).save_pretrained(tmp_path)
    tokenizer.save_pretrained(tmp_path)
    model = load_sam3(str(tmp_path))
    found = model.find(IMAGE, ["red cube", "cube"], 1e-6)
    assert {one.label for one in found} == {"red cube", "cube"}
    assert all(one.mask.shape == (40, 60) and one.mask.dtype == bool and 0 <= one.score <= 1 for one in found)
    assert model.find(IMAGE, ["cube"], 0.9999) == []
