"""What the pages say runs, leads somewhere, and names all that is public."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import meshmash_viewer as mv

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCKS = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)
    )
]


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.filterwarnings("default::meshmash_viewer.TruncationWarning")
def test_python_of_a_page_runs(block: str) -> None:
    exec(compile(block, "page", "exec"), {"__name__": "page"})


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


def test_the_reference_names_all_that_is_public() -> None:
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    named = {line.rsplit(".", 1)[1] for line in re.findall(r"^::: (\S+)$", page, re.M)}
    assert named == set(mv.__all__) - {"__version__"}


@pytest.mark.parametrize("name", sorted(set(mv.__all__) - {"__version__"}))
def test_every_public_name_has_an_example_that_runs(name: str) -> None:
    assumed = {"np": np, "mv": mv}  # as the reference says
    (tests,) = doctest.DocTestFinder(recurse=False).find(getattr(mv, name), name, globs=assumed)
    runs = [example for example in tests.examples if doctest.SKIP not in example.options]
    assert runs or name == "view", "which opens a window"
    assert tests.examples
    wrong: list[str] = []
    doctest.DocTestRunner().run(tests, out=wrong.append)
    assert not wrong, "".join(wrong)
