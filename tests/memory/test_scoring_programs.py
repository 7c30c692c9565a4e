"""What a program needs against what a scene has."""

import math
from typing import Any

import pytest

from gvla2.memory.retrieval import share_filled


def program(**roles: str) -> dict[str, Any]:
    return {"kind": "program", "skill": "pick", "language": "calls", "roles": roles, "steps": []}


@pytest.mark.parametrize(
    ("roles", "objects", "share"),
    [
        ({"theme": "cup cylinder"}, ("red cup cylinder", "cube box"), 1.0),
        ({"theme": "cup cylinder"}, ("mug cylinder",), 0.5),
        ({"theme": "cup cylinder"}, ("cube box",), 0.0),
        ({"theme": "cups"}, ("cup",), 1.0),
        # One object fills one role, and the better pair is taken first.
        ({"theme": "cup", "goal": "cup"}, ("red cup",), 0.5),
        ({"theme": "cup cylinder", "goal": "cup"}, ("cup", "cup cylinder"), 1.0),
        ({"theme": ""}, ("cup",), 1.0),
    ],
)
def test_shares(roles: dict[str, str], objects: tuple[str, ...], share: float) -> None:
    assert share_filled(program(**roles), objects) == pytest.approx(share)


@pytest.mark.parametrize(
    ("effect", "objects"),
    [
        (None, ("cup",)),
        ({"kind": "prior", "roles": {"theme": "cup"}}, ("cup",)),
        (program(), ("cup",)),
        (program(theme="cup"), ()),
        ({**program(), "roles": "cup"}, ("cup",)),
    ],
)
def test_where_there_is_nothing_to_compare(effect: dict[str, Any] | None, objects: tuple[str, ...]) -> None:
    assert math.isnan(share_filled(effect, objects))
