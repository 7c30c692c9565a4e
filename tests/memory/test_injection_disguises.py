"""What a text may not bring into a prompt."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.memory.injection_patterns import invisible, sanitised


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Lift the cup.", "Lift the cup."),
        ("Lift\u200b the\u202e cup\u00ad.", "Lift the cup."),
        ("See https://evil.example/x?q=1 for more.", "See (link) for more."),
        ("see www.example.org/a", "see (link)"),
        ("a\x00b\x07c", "abc"),
        ("first\nsecond\tthird", "first\nsecond\tthird"),
        ("höher 抬高", "höher 抬高"),
        ("tag\U000e0041\U000e0042", "tag"),
    ],
)
def test_what_is_shown(text: str, shown: str) -> None:
    assert sanitised(text) == shown


@pytest.mark.parametrize(
    "frame",
    [
        "<|im_start|>",
        "[INST]",
        "<<SYS>>",
        "</system>",
        "<memory note='x'>",
        "### System:",
        "```",
        "<</SYS>>",
        "[/INST]",
    ],
)
def test_frames_are_taken_off(frame: str) -> None:
    assert frame not in sanitised(f"{frame} lift the cup")
    assert "lift the cup" in sanitised(f"{frame} lift the cup")
    assert frame not in sanitised(f"<|<|im_start|>|> {frame[:2]}{frame}{frame[2:]}") or len(frame) < 4


@given(st.text(max_size=80))
def test_nothing_invisible_is_left(text: str) -> None:
    assert not any(invisible(letter) for letter in sanitised(text) if letter not in "\n\t")
