"""SAM 2 tiny on rendered pictures; skipped, saying so, without the weights that scripts/fetch_sam brings."""

import os
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.perception.clicks import Prompt
from gvla2.testing import inputs

pytestmark = pytest.mark.model


@pytest.fixture(scope="module")
def weights():
    folder = Path(os.environ.get("GVLA2_MODELS") or "~/.cache/gvla2/models").expanduser() / "sam2_tiny"
    if not any(folder.glob("*decoder*")):
        pytest.skip(f"there is no SAM 2 at {folder}: scripts/fetch_sam brings it (151 MB)")
    pytest.importorskip("onnxruntime")
    return folder


def test_boxes_and_clicks_draw_the_blocks(weights):
    from gvla2_plugins.sam.models import Sam2Onnx

    view = inputs.views(128, masked=inputs.RED)[1]
    truth = view.mask > 0
    rows, columns = np.nonzero(truth)
    box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    picture = Sam2Onnx(str(weights)).encode(view.image)
    middle = Prompt(np.array([[columns.mean() + 0.5, rows.mean() + 0.5]]))
    answer = picture([Prompt(np.zeros((0, 2)), tuple(map(float, box))), middle])
    for masks, scores in zip(answer.masks, answer.scores, strict=True):
        overlaps = [(m & truth).sum() / (m | truth).sum() for m in masks]
        assert max(overlaps) > 0.9
        assert scores.max() > 0.8


def test_files_of_another_model_are_told_by_their_inputs(weights, tmp_path):
    from gvla2_plugins.sam.models import Sam2Onnx

    decoder = next(p for p in weights.iterdir() if "decoder" in p.name)
    for name in ("encoder.onnx", "decoder.onnx"):
        (tmp_path / name).symlink_to(decoder)
    with pytest.raises(ConfigurationError, match="another model than SAM 2"):
        Sam2Onnx(str(tmp_path))
