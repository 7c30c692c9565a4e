"""Things that changed places, and those that only stand in another order."""

import pytest

from gvla2.memory.meaning.conflicts import contradiction
from gvla2.memory.meaning.swaps import swapped


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Put the cup on the plate.", "Put the plate on the cup."),
        ("Fly along the blade from the tip to the root.", "Fly along the blade from the root to the tip."),
        ("Stelle die Tasse auf den Teller.", "Stelle den Teller auf die Tasse."),
    ],
)
def test_changed_places_contradict_in_one_task(first: str, second: str) -> None:
    assert swapped(first, second)
    assert swapped(first, second, one_way=True)
    assert contradiction(first, second, one_task=True) is not None
    assert contradiction(first, second) is None


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Put the cup beside the plate.", "Put the plate beside the cup."),
        ("Wash the cup and the plate.", "Wash the plate and the cup."),
        ("In the cellar, push the crate.", "Push the crate in the cellar."),
    ],
)
def test_what_is_the_same_either_way_does_not(first: str, second: str) -> None:
    assert not swapped(first, second, one_way=True)
    assert contradiction(first, second, one_task=True) is None
