#!/usr/bin/env bash
# What a stand-alone program has to do: start from an empty home without Python on the PATH, compute,
# draw, and open its window. Prints its size and how long it took.
#
#   packaging/check.sh FOLDER MESH     (needs a display)
set -euo pipefail

folder=$1 mesh=$2
home=$(mktemp -d)
trap 'rm -rf "$home"' EXIT
mkdir "$home/none"
alone() {
    env -i DISPLAY="${DISPLAY:-}" XAUTHORITY="${XAUTHORITY:-}" QT_QPA_PLATFORM=xcb LANG=C.UTF-8 \
        HOME="$home" PATH="$home/none" "$folder/meshmash-viewer" "$@"
}
alone --version
alone features "$mesh" --kind hks --count 60 -o "$home/hks.npz" >/dev/null
alone render "$mesh" --count 60 -o "$home/picture.png" >/dev/null
cat >"$home/window.py" <<'PYTHON'
import sys
import time

began = time.perf_counter()
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application

app = application()
window = MainWindow(fresh=True)
window.show()
app.processEvents()
print(f"window after {time.perf_counter() - began:.1f} s")
window.open_mesh(sys.argv[1])
window.wait(60.0)
window.document.compute()
window.wait(120.0)
assert window.document.spectrum.complete, window.stage.message_bar.notice
assert not window.grab().toImage().isNull()
window.close()
PYTHON
alone "$home/window.py" "$mesh"
test -s "$home/hks.npz"
test -s "$home/picture.png"
du -sh "$folder" | awk '{ print $1 " in all" }'
