"""Rules for placing: on or in a goal, beside one, or several things each in its own container."""

from __future__ import annotations

import numpy as np

from gvla2.episode.evidence import difference
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject
from gvla2_plugins.geometric.case import Case, CriterionScore, goal_now, outside_footprint, something_at

LEAST_GROWN = 0.4
"""Least rise of a container where a thing lies in it, as a share of the thing's height."""
DOUBTFUL = 0.35
"""Look difference above which it is hardly the same thing."""
FEWEST = 10
"""Least points for a reliable height."""


def place(case: Case) -> CriterionScore:
    """Everything is at its target: one thing, or several in sequence."""
    several = [name for name in case.evidence.plan.roles if name.startswith("theme_")]
    if not several:
        return placed(case, case.role("theme", "part"), case.role("goal"))
    findings = []
    for name in sorted(several):
        theme = case.role(name)
        goal = case.role(name.replace("theme", "goal"))
        if goal is None and theme is not None:
            goal = _under(case, theme)
        findings.append(placed(case, theme, goal))
    known = [f for f in findings if f.score is not None]
    worst = min(known, key=lambda f: f.score or 0.0, default=None)
    unknown = next((f for f in findings if f.score is None), None)
    # One clear failure decides; else one unknown makes the whole unknown.
    if unknown is not None and (worst is None or (worst.score or 0.0) >= 0.5):
        return unknown
    assert worst is not None
    if (worst.score or 0.0) < 0.5:
        return worst
    return CriterionScore(worst.score, f"All {len(findings)} things are at their targets.")


def placed(case: Case, theme: SceneObject | None, goal: SceneObject | None) -> CriterionScore:
    """The theme rests on the goal, in it, or beside it if so planned, and the hand released it."""
    if theme is None or goal is None:
        return CriterionScore(None, "The plan does not say what to put where.")
    if case.last_held:
        return CriterionScore(0.1, "The hand still holds something at the end.")
    if case.after is None:
        return CriterionScore(None, "Nothing was perceived at the end.")
    later = case.later(theme)
    if later is None:
        return _taken_in(case, theme, goal)
    reach, slack = float(later.extents[:2].max()), max(0.015, 0.2 * float(later.extents[2]))
    beside = _meant_beside(case, theme, goal, reach)
    if beside is not None:
        off = float(np.linalg.norm((later.centre - beside)[:2]))
        if off > max(0.03, 0.5 * reach):
            return CriterionScore(0.1, f"{theme.label} lies {100 * off:.1f} cm from its target.")
        if later.bottom > case.before.table_height + slack:
            return CriterionScore(0.2, f"{theme.label} does not rest on the table.")
        return CriterionScore(1.0, f"{theme.label} rests beside {goal.label}, as planned.")
    found = inside(case, later, goal, reach)
    if (found.score or 0.0) < 0.5 and difference(theme, later) > DOUBTFUL:
        taken = _taken_in(case, theme, goal)  # its match may be a piece of the container
        if taken.score is not None:
            return taken
    now = goal_now(case, goal)
    if found.score == 1.0 and not now.bottom - slack <= later.bottom <= now.top + slack:
        return CriterionScore(0.2, f"{theme.label} is over {goal.label}, but does not rest there.")
    return found


def _taken_in(case: Case, theme: SceneObject, goal: SceneObject) -> CriterionScore:
    """A thing seen as one with its container, as for equal colours: it is gone from its place, and where the hand
    released it, the goal is higher than before by most of the thing's height.
    """
    spot = _let_go(case, theme)
    unknown = CriterionScore(None, f"{theme.label} was not seen again.")
    now = goal_now(case, goal)
    if spot is None or case.after is None or outside_footprint(spot, now) > 0.0 or goal.shape == "region":
        return unknown
    if something_at(theme, case.after, case.config.same_place):
        return CriterionScore(0.2, f"Something is still where {theme.label} was.")
    about = 0.5 * float(theme.extents[:2].max())
    was = _height(case.before, spot, about, frozenset({theme.id}))
    grown = _height(case.after, spot, about, frozenset()) - max(was, goal.bottom)
    if grown >= LEAST_GROWN * (theme.top - theme.bottom):
        return CriterionScore(
            0.85, f"{theme.label} is gone from its place, and {goal.label} is higher where it was put."
        )
    return unknown


def _height(scene: Scene, spot: FloatArray, about: float, but: frozenset[str]) -> float:
    """The highest seen point within ``about`` metres of a spot (3,), without strays, else the table's height."""
    seen = np.concatenate([np.zeros((0, 3)), *(o.points for o in scene.obstacles(but))])
    near = seen[np.linalg.norm(seen[:, :2] - spot[:2], axis=1) < about]
    return float(np.quantile(near[:, 2], 0.9)) if len(near) >= FEWEST else scene.table_height


def inside(case: Case, thing: SceneObject, goal: SceneObject, reach: float) -> CriterionScore:
    """The thing's centre in the goal's footprint; half a width outside, it only touches the goal."""
    outside = outside_footprint(thing.centre, goal_now(case, goal))
    if outside <= case.config.margin:
        return CriterionScore(1.0, f"{thing.label} lies on or in {goal.label}.")
    score = max(0.0, 0.45 * (1 - outside / reach))
    return CriterionScore(score, f"{thing.label} lies {100 * outside:.1f} cm outside {goal.label}.")


def _meant_beside(case: Case, theme: SceneObject, goal: SceneObject, reach: float) -> FloatArray | None:
    """(3,) the planned release point if it is clearly beside the goal; None if it is on or in it."""
    spot = _let_go(case, theme)
    return spot if spot is not None and outside_footprint(spot, goal) > 0.5 * reach else None


def _let_go(case: Case, theme: SceneObject) -> FloatArray | None:
    """(3,) the planned release point of the theme, or of any carried object if the plan does not name it."""
    carried = [w for w in case.planned if w.carries]
    own = [w for w in carried if w.carries == theme.id] or carried
    return np.asarray(own[-1].xyz, dtype=np.float64) if own else None


def _under(case: Case, theme: SceneObject) -> SceneObject | None:
    """The object under the planned release: the smallest footprint there except the theme's."""
    spot = _let_go(case, theme)
    if spot is None:
        return None
    around = [o for o in case.before.objects if o.id != theme.id and outside_footprint(spot, o) == 0.0]
    return min(around, key=lambda o: float(np.prod(o.extents[:2])), default=None)
