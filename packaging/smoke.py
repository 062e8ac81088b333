"""Smoke test of an installed program: redirected output, and a pattern that no shell expands.

    python packaging/smoke.py PROGRAM

PROGRAM is `meshmash-viewer` of the tested environment.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

OBJ = """v 0 0 {height}
v 1 0 0
v 0 1 0
v -1 -1 0
f 1 2 3
f 1 3 4
f 1 4 2
f 2 4 3
"""


def smoke(program: str, folder: Path) -> None:
    """Run three commands on two small meshes in `folder`; raise if one fails or prints nothing."""
    for name, height in (("first", 1), ("second", 2)):
        (folder / f"{name}.obj").write_text(OBJ.format(height=height), encoding="utf-8")
    environment = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    for arguments in (
        ["--help"],
        ["info", "*.obj", "--unit", "um"],
        ["features", "*.obj", "--kind", "hks", "--count", "4", "-o", "features/"],
    ):
        printed = folder / "printed.txt"
        with printed.open("wb") as file:  # a file, so that the output has the system's encoding
            subprocess.run(
                [Path(program).absolute(), *arguments],
                cwd=folder,
                env=environment,
                stdout=file,
                stderr=subprocess.STDOUT,
                check=True,
            )
        sys.stdout.buffer.write(printed.read_bytes())  # in the same encoding
        sys.stdout.flush()
        if not printed.stat().st_size:
            raise SystemExit(f"{' '.join(arguments)} printed nothing")
    if len(list((folder / "features").iterdir())) < 2:
        raise SystemExit("features of two meshes were expected")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as made:
        smoke(sys.argv[1], Path(made))
