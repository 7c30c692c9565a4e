"""What a model's answer is taken for when it consolidates."""

import pytest

from gvla2.errors import Gvla2Error
from gvla2_plugins.governed.writer import read_edit


def test_an_edit_may_stand_in_a_fence_or_after_other_words():
    answer = (
        'I think {so}.\n```json\n{"action": "MERGE", "target": "a", "content": "5 cm", "reason": null}\n```'
    )
    edit = read_edit(answer, ["a", "b"])
    assert (edit.action, edit.target, edit.content, edit.reason) == ("MERGE", "a", "5 cm", "")
    assert read_edit('{"action": "ADD"}', []).target == ""


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("no idea", "no edit"),
        ('{"action": "FORGET", "target": "a"}', "no edit"),
        ('{"action": "MERGE", "target": "z", "content": "x"}', "was not shown"),
        ('{"action": "DISCARD"}', "was not shown"),
    ],
)
def test_anything_else_is_an_error(answer: str, said: str):
    with pytest.raises(Gvla2Error, match=said):
        read_edit(answer, ["a"])
