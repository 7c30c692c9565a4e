"""The page about skills shows the table as it is, and a plugin that exists and works."""

from pathlib import Path

from gvla2.skills.table import describe

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "skills.md").read_text()


def test_the_table_is_the_one_that_planners_see():
    assert describe() in PAGE


def test_the_skill_of_your_own_is_the_example_and_short():
    source = (ROOT / "examples" / "third_party" / "gvla2_hover" / "skill.py").read_text()
    assert source in PAGE
    assert len(source.splitlines()) <= 30
