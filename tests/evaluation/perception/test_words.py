"""Labels by their words."""

import pytest

from gvla2.evaluation.perception.words import Words, compare, head_noun


@pytest.mark.parametrize(
    ("true", "perceived", "expected"),
    [
        ("red cube", "red cube", Words(True, True, True)),
        ("red cube", "maroon cube", Words(False, False, True)),
        ("red cube", "red ball", Words(False, True, False)),
        ("rose cup", "pink cup", Words(True, True, True)),
        ("yellow mustard bottle", "yellow bottle", Words(True, True, True)),
        ("gray umbrella stand", "gray umbrella", Words(False, True, False)),
        ("box lid", "teal lid", Words(True, None, True)),
        ("handle", "", Words(False, None, False)),
        ("red and blue ball", "red ball", Words(False, False, True)),
        ("white pile", "white tower", Words(True, True, True)),
        ("", "red cube", Words(None, None, None)),
    ],
)
def test_colours_and_head_nouns_decide(true, perceived, expected):
    assert compare(true, perceived) == expected


def test_a_head_noun_is_never_a_colour():
    assert head_noun("the Cup, grey") == "cup"
    assert head_noun("silver") == ""
