"""Hooks of MkDocs: formulas as MathML, and the program's icon.

A fenced block of the language ``math`` contains a formula in LaTeX, which code hosts typeset. On
the site it is converted to MathML, which browsers draw without scripts or downloaded fonts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ICON = Path(__file__).resolve().parent.parent / "meshmash_viewer" / "app" / "icon.png"


def math_fence(source: str, *_: Any, **__: Any) -> str:
    """Return the HTML of a formula."""
    return f'<div class="formula">{convert(source, display="block")}</div>'


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the icon of the window to the site."""
    files.append(File.generated(config, "pictures/icon.png", abs_src_path=str(ICON)))
    return files
