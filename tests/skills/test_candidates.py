from hypothesis import given
from hypothesis import strategies as st

from gvla2.skills.candidates import _ranked


class Walk:
    """Falls to each of its scores in turn."""

    def __init__(self, scores: list[int]) -> None:
        self.scores, self.ranked, self.steps = sorted(scores, reverse=True), False, 0

    @property
    def score(self) -> int:
        return self.scores[self.steps]

    def step(self) -> bool:
        self.steps += 1 if (more := self.steps + 1 < len(self.scores)) else 0
        return more


@given(st.lists(st.lists(st.integers(0, 6), min_size=1, max_size=5), max_size=8))
def test_walks_come_in_the_order_of_their_last_scores(scores):
    walks = [Walk(one) for one in scores]
    order = sorted(walks, key=lambda walk: -walk.scores[-1])  # stable
    assert list(_ranked(walks)) == order


def test_the_best_is_known_before_the_others_are_followed_to_their_ends():
    low, best, far = Walk([9, 3, 2, 1]), Walk([9, 8, 7]), Walk([6, 5])
    assert next(_ranked([low, best, far])) is best
    assert (low.steps, far.steps, low.ranked) == (1, 0, False)
