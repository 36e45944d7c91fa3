"""What the documentation points at is there."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LINK = re.compile(r"\[([^\]]*)\]\(([^()\s]+)\)")


def links(page: Path) -> list[tuple[str, str]]:
    """Text and target of a page's links, those in blocks of code left out."""
    return LINK.findall(re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL))


def anchors(page: Path) -> set[str]:
    """Names that GitHub gives to the headings of a page."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def python_names(body: list[ast.stmt], prefix: str = "") -> Iterator[str]:
    """Functions, classes and variables of a module, those of classes as ``Class.name``."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield prefix + node.name
        if isinstance(node, ast.ClassDef):
            yield from python_names(node.body, f"{prefix}{node.name}.")
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
        yield from (prefix + target.id for target in targets if isinstance(target, ast.Name))


def rust_names(text: str) -> set[str]:
    """Functions and types of a module, methods as ``Type::name``."""
    named = re.compile(r"^( *)(?:pub(?:\(\w+\))? )?(?:fn|struct|enum|trait) (\w+)")
    block = re.compile(r"^impl(?:<[^>]*>)? (?:[\w:<>' ]+ for )?(\w+)")
    found: set[str] = set()
    owner = ""
    for line in text.splitlines():
        if start := block.match(line):
            owner = f"{start[1]}::"
        elif name := named.match(line):
            found.add((owner if name[1] else "") + name[2])
    return found


def is_defined(name: str, source: Path) -> bool:
    text = source.read_text()
    if source.suffix == ".rs":
        return name in rust_names(text)
    return name in python_names(ast.parse(text).body)


def test_links_of_the_documentation_lead_somewhere(repository: Path) -> None:
    lost: list[str] = []
    for page in (repository / "README.md", *sorted((repository / "docs").rglob("*.md"))):
        for _, target in links(page):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            place = page.parent / path if path else page
            if not place.exists() or (anchor and anchor not in anchors(place)):
                lost.append(f"{page.relative_to(repository)}: {target}")
    assert lost == []


def test_names_that_the_page_on_the_paper_links_are_defined_there(repository: Path) -> None:
    page = repository / "docs" / "paper.md"
    named = [
        (text.strip("`"), page.parent / target)
        for text, target in links(page)
        if text.startswith("`") and target.endswith((".py", ".rs"))
    ]
    assert len(named) > 40
    assert [(name, str(source)) for name, source in named if not is_defined(name, source)] == []


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("TrackOptions.no_such_rule", "python/mvmatch/tracks.py"),
        ("preset", "python/mvmatch/tracks.py"),  # of a class, not of the module
        ("Cosine::no_such_test", "crates/motion-tracks/src/motion.rs"),
        ("Motion::accepts", "crates/motion-tracks/src/motion.rs"),  # Cosine's
    ],
)
def test_a_name_that_is_not_there_is_not_found(repository: Path, name: str, file: str) -> None:
    assert not is_defined(name, repository / file)


def test_no_page_holds_the_marks_of_a_merge(repository: Path) -> None:
    pages = [*repository.glob("*.md"), *(repository / "docs").rglob("*.md")]
    marks = re.compile(r"^(<{7} |>{7} )", re.MULTILINE)
    assert len(pages) > 20
    assert [page.name for page in pages if marks.search(page.read_text(encoding="utf-8"))] == []
