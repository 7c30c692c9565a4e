"""Forms of a word are one word, and the quick test never says more than the slow one."""

from hypothesis import given
from hypothesis import strategies as st

from gvla2.memory.word_forms import alike, begin_apart, split_alike

WORDS = st.frozensets(
    st.sampled_from(
        ["grip", "grippe", "gripper", "grid", "turn", "turnt", "nr1x", "nr12x", "side+", "side-", "a", "杯"]
    )
)


@given(WORDS, WORDS)
def test_what_begins_apart_is_left_over(first: frozenset[str], second: frozenset[str]) -> None:
    _, left, right = split_alike(first, second)
    assert not begin_apart(first, second) or left
    assert not begin_apart(second, first) or right
    assert not begin_apart(first, first)


def test_forms() -> None:
    assert alike("drawer", "drawers")
    assert not alike("cup", "cap")
    assert not alike("nr1x", "nr12x")
    assert not alike("side+", "side-")
    assert begin_apart(frozenset({"cup"}), frozenset({"lid"}))
