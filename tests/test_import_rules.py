"""Import rules: one direction numerics, fields, io, model, app; VTK in the render only."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from itertools import product
from pathlib import Path

import pytest

import meshmash_viewer
from meshmash_viewer.fields import FAMILIES

PACKAGE = Path(meshmash_viewer.__file__).parent
MODULES = {
    ".".join(("meshmash_viewer", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
WINDOW_LIBRARIES = {"PySide6", "pyqtgraph", "pyvista", "pyvistaqt", "superqt", "vtk", "vtkmodules"}
VTK = {"pyvista", "pyvistaqt", "vtk", "vtkmodules"}

#: Layers that each layer may import besides itself.
ALLOWED = {
    "numerics": set(),
    "fields": {"numerics"},
    "io": {"numerics", "fields"},
    "model": {"numerics", "fields", "io"},
    "app": {"numerics", "fields", "io", "model"},
    "cli": {"numerics", "fields", "io", "model", "app"},
}
#: Modules outside app/ that import VTK inside functions: conversion, reader, writer.
VTK_OUTSIDE_APP = {
    "meshmash_viewer.mesh",
    "meshmash_viewer.triangulation",
    "meshmash_viewer.io.formats.vtk",
    "meshmash_viewer.io.writers",
}
#: Folder in app/ that imports VTK: the render, and pictures without a window.
VTK_INSIDE_APP = ("view",)

#: Modules that may name a family, besides its own, its tab and the table, and why.
KNOW_A_FAMILY = {
    "meshmash_viewer.app.opening": {"map"},  # key of kept maps
    "meshmash_viewer.app.panels.pair_panel": {"eigenfunction"},  # shows corresponding pairs
    "meshmash_viewer.app.plots.spectrum_views": {"eigenfunction"},  # draws eigenvalues
    "meshmash_viewer.app.tabs.map_tab": {"filter"},  # filters a map
    "meshmash_viewer.app.tabs.parameters": {"filter"},  # parameters in two tabs
    "meshmash_viewer.app.tabs.pin_tabs": {"distance", "similarity"},  # measured from a pin
    "meshmash_viewer.app.tabs.spectral_tabs": {"eigenfunction", "filter"},  # tabs of both
    "meshmash_viewer.app.tabs": {  # tabs with more than a form
        "eigenfunction",
        "filter",
        "similarity",
        "distance",
        "map",
    },
    "meshmash_viewer.model.document": {"eigenfunction", "similarity"},  # flips, measures from a pin
    "meshmash_viewer.io.formats.brain": {"map"},  # name of a nameless map
    "meshmash_viewer.model.maps": {"map"},  # shows a new map
    "meshmash_viewer.fields.maps": {"filter", "band"},  # views with these names
    "meshmash_viewer.fields.similarity": {"hks"},  # default features
}
#: Kinds that commands use by default or extend with options.
NAMED_BY_THE_COMMAND_LINE = {"hks", "map", "wks"}


def layer(module: str) -> str:
    first = module.split(".")[1] if "." in module else ""
    if first in ("fields", "io", "model", "app"):
        return first
    if first == "pieces":  # public names of numerics and files
        return "io"
    return "cli" if first in ("cli", "__main__") else "numerics"


@cache
def parsed(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def imports(module: str, top_level_only: bool = False) -> frozenset[str]:
    """Return full names of all imported modules, by default also of imports inside functions."""
    tree = parsed(module)
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    found = set()
    for node in outside_functions(tree) if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                origin = ".".join([*parents, *filter(None, [origin])])
            for alias in node.names:
                whole = f"{origin}.{alias.name}"
                found.add(whole if whole in MODULES else origin)
    return frozenset(found)


def outside_functions(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from outside_functions(child)


def roots(names: Iterable[str]) -> set[str]:
    return {name.partition(".")[0] for name in names}


def loaded_by(code: str) -> set[str]:
    """Return the modules that a new interpreter has loaded after running some code."""
    script = f"{code}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-W", "error::SyntaxWarning", "-c", script],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return set(json.loads(run.stdout.splitlines()[-1]))


def test_nothing_outside_app_loads_the_window_libraries() -> None:
    names = [name for name in MODULES if layer(name) != "app" and not name.endswith("__main__")]
    loaded = loaded_by("\n".join(f"import {name}" for name in names))
    assert set(names) <= loaded
    assert not roots(loaded) & WINDOW_LIBRARIES


def test_importing_the_package_costs_nothing() -> None:
    # Public names are loaded at first use. Times would depend on the machine.
    loaded = roots(loaded_by("import meshmash_viewer"))
    heavy = {"joblib", "matplotlib", "nibabel", "numpy", "pandas", "pyarrow", "pymetis", "scipy"}
    heavy |= {"robust_laplacian", "trimesh", "tqdm", "psygnal"}
    assert not loaded & (heavy | WINDOW_LIBRARIES)


def test_the_numerics_need_little_beyond_numpy_and_scipy() -> None:
    code = "import meshmash_viewer as mv\n"
    code += "\n".join(f"mv.{name}" for name in meshmash_viewer.__all__ if name != "view")
    loaded = roots(loaded_by(code))
    late = {"matplotlib", "nibabel", "pandas", "pyarrow", "trimesh"} | WINDOW_LIBRARIES
    assert not loaded & late


def test_imports_go_one_way() -> None:
    wrong = [
        f"{module} ({layer(module)}) imports {name}"
        for module in sorted(set(MODULES) - {"meshmash_viewer"})
        for name in imports(module)
        if name.startswith("meshmash_viewer.")
        and layer(name) not in ALLOWED[layer(module)] | {layer(module)}
    ]
    assert not wrong


def test_no_module_needs_itself() -> None:
    # Imports inside functions and for annotations count.
    needs = {module: imports(module) - {module} for module in MODULES}
    TopologicalSorter(needs).prepare()


def test_window_libraries_outside_app() -> None:
    for module in MODULES:
        if layer(module) != "app":
            top = roots(imports(module, top_level_only=True))
            assert not top & WINDOW_LIBRARIES, module
            allowed = VTK if module in VTK_OUTSIDE_APP else set()
            assert roots(imports(module)) & WINDOW_LIBRARIES <= allowed, module


def test_only_the_scene_knows_vtk() -> None:
    for module in MODULES:
        part = module.split(".")[2] if module.count(".") > 1 else ""
        if layer(module) == "app" and part not in VTK_INSIDE_APP:
            assert not roots(imports(module)) & VTK, module


def test_panels_know_the_model_and_not_one_another() -> None:
    for module in MODULES:
        if not module.endswith(("_panel", "_tab", "_dialog")):
            continue
        others = {name for name in imports(module) if name.endswith(("_panel", "_dialog"))}
        if module.endswith("_tab"):
            others |= {name for name in imports(module) if name.endswith("_tab")}
        assert not others, module
        assert "meshmash_viewer.app.main_window" not in imports(module), module


def test_a_family_is_known_by_its_file_its_tab_and_the_table() -> None:
    """Other modules use the methods of `Family` and name no family."""
    for (name, family), module in product(FAMILIES.items(), MODULES):
        own = {family.__module__, "meshmash_viewer.fields.table"}
        said = {name, *([family.export] if family.counted else [])}
        its_tab = module.startswith(f"meshmash_viewer.app.tabs.{name}_")
        if layer(module) == "numerics" or module in own or its_tab:
            continue
        if name in KNOW_A_FAMILY.get(module, ()):
            continue
        if layer(module) == "cli" and name in NAMED_BY_THE_COMMAND_LINE:
            continue
        assert family.__module__ not in imports(module), module
        assert not said & names_in(module), module


@cache
def names_in(module: str) -> frozenset[str]:
    """Return the string constants of a module except arguments of `counted`."""
    nodes = list(ast.walk(parsed(module)))
    nouns = [
        argument
        for node in nodes
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "counted"
        for argument in node.args
    ]
    texts = [node for node in nodes if isinstance(node, ast.Constant) and node not in nouns]
    return frozenset(node.value for node in texts if isinstance(node.value, str))


def test_the_command_line_loads_the_window_only_to_open_one() -> None:
    for module in MODULES:
        if layer(module) == "cli":
            top = imports(module, top_level_only=True)
            assert not {name for name in top if name.startswith("meshmash_viewer.app")}


@pytest.mark.parametrize("arguments", ["'--help'", "'features', '--help'"])
def test_the_help_comes_before_anything_heavy(arguments: str) -> None:
    code = f"import sys; sys.argv = ['meshmash-viewer', {arguments}]\n"
    code += "from meshmash_viewer.cli.main import main\n"
    code += "try:\n    main()\nexcept SystemExit:\n    pass"
    assert not roots(loaded_by(code)) & (WINDOW_LIBRARIES | {"scipy", "pyarrow", "trimesh"})
