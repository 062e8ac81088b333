"""Pictures of docs/gallery.md, made by the commands on that page.

    python assets/gallery.py FOLDER

writes FOLDER/NAME.webp for each NAME.png of a command. The page shows the
pictures in docs/pictures/gallery.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import tempfile
from pathlib import Path

from PIL import Image

from meshmash_viewer.cli.main import main as command_line
from meshmash_viewer.samples import SAMPLES, sample_path

PAGE = Path(__file__).resolve().parent.parent / "docs" / "gallery.md"
WIDTH = 1200


def main() -> int:
    """Run the commands in a folder with the samples, and shrink their pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the pictures go")
    out = parser.parse_args().folder.absolute()
    out.mkdir(parents=True, exist_ok=True)
    commands = re.findall(r"^meshmash-viewer (.+)$", PAGE.read_text(encoding="utf-8"), re.M)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name in SAMPLES:
            Path(f"{name}.npz").symlink_to(sample_path(name))
        for command in commands:
            if status := command_line(shlex.split(command)):
                return status
        for file in sorted(Path().glob("*.png")):
            picture = Image.open(file).convert("RGB")
            picture.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
            picture.save(out / f"{file.stem}.webp", quality=88, method=6)
        os.chdir(out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
