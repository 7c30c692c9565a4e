"""One self-contained page of tasks: how each starts and how it ends, from every camera."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from PIL import Image

from gvla2.geometry.views import View
from gvla2.record.drawing import png

STYLE = """
:root { color-scheme: light dark; --ink: #1c2430; --soft: #5b6675; --line: #d9dee5; --ground: #fff; --good: #1a7f4b;
  --bad: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ee; --soft: #9aa5b4; --line: #333c48; --ground: #14181e;
  --good: #5ecb92; --bad: #ff8a80; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--ground); max-width: 72rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .2rem; }
nav { display: flex; flex-wrap: wrap; gap: .3rem .9rem; } nav a { color: inherit; }
section { border-top: 1px solid var(--line); }
p { margin: .2rem 0; } .soft { color: var(--soft); } .good { color: var(--good); } .bad { color: var(--bad); }
.row { display: grid; grid-template-columns: 5rem repeat(auto-fit, minmax(8rem, 1fr)); gap: .5rem; margin: .6rem 0;
  align-items: center; }
figure { margin: 0; } img { width: 100%; display: block; border-radius: 4px; }
figcaption { font-size: .8rem; color: var(--soft); }
details { margin: .4rem 0; } ul { margin: .2rem 0; }
"""


@dataclass(frozen=True)
class Shown:
    """One task of the gallery. ``ending`` says how it was brought to its ``after``; ``done`` whether it counts.

    ``problem`` is what went wrong, "" for nothing.
    """

    name: str
    summary: str
    instruction: str
    goal: str
    wordings: tuple[str, ...]
    before: tuple[View, ...] = ()
    after: tuple[View, ...] = ()
    ending: str = ""
    done: bool = False
    problem: str = ""


def gallery_page(tasks: Sequence[Shown], seed: int) -> str:
    """The page as HTML, pictures inside."""
    contents = "\n".join(f'<a href="#{escape(t.name)}">{escape(t.name)}</a>' for t in tasks)
    sections = "\n".join(_section(task) for task in tasks)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>gvla2: {len(tasks)} tasks</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head><body>
<h1>{len(tasks)} tasks, seed {seed}</h1>
<p class="soft">Each as it starts and as it ends, from every camera. The endings are scripted demonstrations that know
the true state: they show that the arm can do it, not that any planner does.</p>
<nav>{contents}</nav>
{sections}
</body></html>
"""


def _section(task: Shown) -> str:
    wordings = "".join(f"<li>{escape(w)}</li>" for w in task.wordings)
    verdict = ""
    if task.problem:
        verdict = f'<p class="bad">{escape(task.problem)}</p>'
    elif task.ending:
        verdict = f'<p class="{"good" if task.done else "bad"}">{escape(task.ending)}</p>'
    return f"""<section id="{escape(task.name)}"><h2>{escape(task.name)}</h2>
<p>{escape(task.summary)}</p><p>“{escape(task.instruction)}”</p><p class="soft">{escape(task.goal)}</p>
{_row("start", task.before)}{_row("end", task.after)}{verdict}
<details><summary>{len(task.wordings)} wordings</summary><ul>{wordings}</ul></details></section>"""


def _row(word: str, views: Sequence[View]) -> str:
    if not views:
        return ""
    figures = "".join(
        f'<figure><img alt="{escape(view.name)}, {word}" src="{_inline(view)}">'
        f"<figcaption>{escape(view.name)}</figcaption></figure>"
        for view in views
    )
    return f'<div class="row"><span class="soft">{word}</span>{figures}</div>'


def _inline(view: View) -> str:
    picture = png(Image.fromarray(view.image))
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
