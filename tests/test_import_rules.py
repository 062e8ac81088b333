"""The house has one direction: numerics, fields, io, model, app; only the render knows VTK."""

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

#: What each layer may import besides itself.
ALLOWED = {
    "numerics": set(),
    "fields": {"numerics"},
    "io": {"numerics", "fields"},
    "model": {"numerics", "fields", "io"},
    "app": {"numerics", "fields", "io", "model"},
    "cli": {"numerics", "fields", "io", "model", "app"},
}
#: Modules outside app/ that touch VTK, inside functions: a conversion, a reader, a writer.
VTK_OUTSIDE_APP = {
    "meshmash_viewer.mesh",
    "meshmash_viewer.triangulation",
    "meshmash_viewer.io.formats.vtk",
    "meshmash_viewer.io.writers",
}
#: The folder of the window that touches VTK: the render, and pictures without a window.
VTK_INSIDE_APP = ("view",)

#: Who knows a family besides its file, its tab and the table, and why.
KNOW_A_FAMILY = {
    "meshmash_viewer.app.opening": {"map"},  # the word, in what it says was kept
    "meshmash_viewer.app.panels.pair_panel": {"eigenfunction"},  # which of them correspond
    "meshmash_viewer.app.plots.spectrum_views": {"eigenfunction"},  # whose eigenvalues it draws
    "meshmash_viewer.app.tabs.map_tab": {"filter"},  # what a map is passed through
    "meshmash_viewer.app.tabs.parameters": {"filter"},  # whose parameters two tabs have
    "meshmash_viewer.app.tabs.pin_tabs": {"distance", "similarity"},  # which refer to a pin
    "meshmash_viewer.app.tabs.spectral_tabs": {"eigenfunction", "filter"},  # which it is about
    "meshmash_viewer.app.tabs": {  # which have more controls than a form
        "eigenfunction",
        "filter",
        "similarity",
        "distance",
        "map",
    },
    "meshmash_viewer.model.document": {"eigenfunction", "similarity"},  # flips, measures from a pin
    "meshmash_viewer.io.formats.brain": {"map"},  # the word, for one without a name
    "meshmash_viewer.model.maps": {"map"},  # shows a new one
    "meshmash_viewer.fields.maps": {"filter", "band"},  # likewise, and a view of that name
    "meshmash_viewer.fields.similarity": {"hks"},  # in which it measures before one chooses
}
#: The kinds that commands take by default or whose options they add to.
NAMED_BY_THE_COMMAND_LINE = {"hks", "map", "wks"}


def layer(module: str) -> str:
    first = module.split(".")[1] if "." in module else ""
    if first in ("fields", "io", "model", "app"):
        return first
    return "cli" if first in ("cli", "__main__") else "numerics"


@cache
def parsed(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def imports(module: str, top_level_only: bool = False) -> frozenset[str]:
    """Full names of the modules that a module imports; those inside functions too, unless told."""
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
    """Modules that a fresh interpreter has loaded after running some code."""
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
    # Its public names are loaded when they are first used; a clock would only tell of the machine.
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
    # imports inside functions, and those for annotations, count
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
    """Whoever else needs something of it asks all of them, by a method of `Family`."""
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
    """Texts that a module knows, but for the nouns that it counts."""
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
