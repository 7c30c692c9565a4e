"""What MkDocs does beside rendering ``docs``: pages that are made when the site is built, and links to the sources.

A link from a page to a file outside ``docs`` leads to a page with that file, so that the site is whole by itself.
"""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
from reference import ROOT, contract, hooks_table, reference

from gvla2.plugins.registry import load_plugins

DOCS = ROOT / "docs"
HERE_TOO = {"contributing.md": "CONTRIBUTING.md", "changes.md": "CHANGELOG.md"}
SHIM = "https://unpkg.com/iframe-worker/shim"
WORKER = Path(__file__).with_name("worker.js").read_text()
TABLE = "<!-- the table of hooks -->"
LINK = re.compile(r"\]\(([^)#:\s]+)(#[^)\s]*)?\)")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".md": "markdown", ".yml": "yaml", "": "sh"}
ROLE = re.compile(r":\w+:<code>~?(?:[\w.]+[.:])?(\w+(?:\(\))?)</code>")


def on_config(config: Any) -> Any:
    """Pages that nobody put into the navigation come last in it, so that none is lost."""
    listed = set(re.findall(r"[\w/]+\.md", str(config.nav)))
    config.nav[-1]["More"] += [page.name for page in sorted(DOCS.glob("*.md")) if page.name not in listed]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made."""
    made = reference(load_plugins())
    made |= {page: (ROOT / source).read_text() for page, source in HERE_TOO.items()}
    for page in DOCS.rglob("*.md"):
        for target in (outside(page, link) for link, _ in LINK.findall(page.read_text())):
            if target and (ROOT / target).is_file():
                made[f"source/{target}.md"] = _listing(target)
    for uri, content in made.items():
        files.append(File.generated(config, uri, content=content))
    return files


def on_post_page(output: str, **_: Any) -> str:
    """The theme fetches what its search needs where pages are read from files; ours is in the page."""
    return output.replace(f'<script src="{SHIM}"></script>', f"<script>{WORKER}</script>")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Complete pages about hooks, and lead links to sources to their pages."""
    uri = page.file.src_uri
    registry = load_plugins() if uri.startswith("hooks/") else None
    if registry is not None:
        kind = next((k for k in registry.kinds.values() if uri == f"hooks/{k.hook}.md"), None)
        markdown = markdown.replace(TABLE, hooks_table(registry))
        markdown += f"\n{contract(kind)}" if kind else ""

    def lead(found: re.Match[str]) -> str:
        target = outside(DOCS / uri, found[1])
        if not target or not (ROOT / target).is_file():
            return found[0]
        return f"]({posixpath.relpath(f'source/{target}.md', posixpath.dirname(uri) or '.')}{found[2] or ''})"

    return LINK.sub(lead, markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Roles of docstrings are code and nothing more."""
    return ROLE.sub(r"<code>\1</code>", html)


def outside(page: Path, link: str) -> str:
    """Where a link leads, from the repository's root, if that is outside ``docs``; "" otherwise."""
    target = (page.parent / link).resolve()
    inside = target.is_relative_to(DOCS) or not target.is_relative_to(ROOT)
    return "" if inside else target.relative_to(ROOT).as_posix()


def _listing(target: str) -> str:
    text = (ROOT / target).read_text()
    language = LANGUAGES.get(Path(target).suffix, "text")
    return f"---\nsearch:\n  exclude: true\n---\n# `{target}`\n\n````{language}\n{text}\n````\n"
