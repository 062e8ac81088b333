"""Many meshes on a Dask scheduler, and interrupted runs that are resumed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import shapes
from faults import raises
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.cli.parser import parsed_command
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.split.stitcher import PieceError

distributed = pytest.importorskip("distributed")
#: A separate process with a scheduler and workers, which prints its address.
ALONE = """
import distributed, sys
if __name__ == "__main__":
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Start two processes of one thread each, on the loopback address."""
    cache = str(tmp_path_factory.mktemp("cache"))
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",
        env={"MESHMASH_CACHE": cache},
    ) as made:
        yield made


@pytest.fixture
def threads() -> Iterator[Any]:
    """Start two workers in the test's process, which is fast."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as made:
        yield made


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write three meshes of different sizes, and a file without a mesh."""
    monkeypatch.chdir(tmp_path)
    for number in range(3):
        save(number)
    Path("m1_bad.ply").write_text("no mesh")
    return tmp_path


def save(number: int, finer: int = 2) -> None:
    mesh = shapes.blob(finer)
    write_mesh(f"m{number}.ply", mv.Mesh(mesh.vertices * (1 + number), mesh.faces, "nm"))


def features(out: str, *more: str) -> int:
    return main(["features", "*.ply", "--count", "30", "--no-cache", "-o", f"{out}/", *more])


def content(file: Path) -> dict[str, Any]:
    """Return the content of an NPZ file except the date of its creation."""
    with np.load(file) as archive:
        arrays = {name: archive[name].tobytes() for name in archive.files if name != "meta"}
        about = json.loads(str(archive["meta"]))
    return arrays | {"meta": about | {"created": ""}}


def rows(file: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = pyarrow.parquet.read_table(file).to_pylist()
    return found


def check_same(one: str, other: str, count: int) -> None:
    files = sorted(Path(one).glob("*.npz"))
    assert [file.name for file in files] == [
        file.name for file in sorted(Path(other).glob("*.npz"))
    ]
    assert len(files) == count
    for file in files:
        assert content(file) == content(Path(other, file.name)), file.name


@pytest.mark.parametrize("workers", [slow("cluster"), "threads"])
def test_a_cluster_writes_what_one_process_writes_and_lists_what_failed(
    workers: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    cluster = request.getfixturevalue(workers)
    assert features("here", "--jobs", "1") == 2
    said = capsys.readouterr()
    assert features("there", "--scheduler", cluster.scheduler_address) == 2
    there = capsys.readouterr()
    check_same("here", "there", 3)
    assert sorted(there.out.splitlines()) == sorted(
        said.out.replace("here/", "there/").splitlines()
    )
    first, *_, bad, last = there.err.splitlines()
    assert f"2 workers of {cluster.scheduler_address}" in first
    assert bad == said.err.splitlines()[-1]
    assert "m1_bad.ply" in bad
    assert "3 of 4 meshes done, 1 failed; manifest: " in last
    ball, _, broken, _ = rows("there/manifest_features.parquet")
    assert ball["mesh"] == str(Path("m0.ply").absolute())
    assert (ball["output"], ball["status"], ball["fault"]) == ("m0.npz", "done", None)
    assert ball["hash"] == mv.read_mesh("m0.ply").content_hash
    assert (ball["pairs"], ball["complete"]) == (30, True)
    assert 0.0 < ball["residual"] < 1e-8
    assert 0.0 < ball["orthonormality"] < 1e-8
    assert 0.0 < ball["truncation"] < 1.0
    assert ball["seconds"] > 0.0
    assert ball["bytes"] == Path("there/m0.npz").stat().st_size
    assert (broken["status"], broken["pairs"]) == ("failed", None)
    assert broken["fault"] in bad


@pytest.mark.slow
def test_a_run_goes_on_where_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    Path("m1_bad.ply").unlink()

    def computed(*more: str) -> list[str]:
        capsys.readouterr()
        assert features("out", "--resume", *more) == 0
        return [line[4:6] for line in capsys.readouterr().out.splitlines()]

    assert computed() == ["m0", "m1", "m2"]
    assert computed() == []
    assert computed("--jobs", "2") == []
    assert computed("--n-components", "5") == ["m0", "m1", "m2"]
    Path("out/m0.npz").unlink()
    Path("m1.ply").write_bytes(Path("m2.ply").read_bytes())
    assert computed("--n-components", "5") == ["m0", "m1"]
    Path("out/m2.npz").write_bytes(b"cut off")
    assert computed("--n-components", "5") == ["m2"]
    # Changed values in the mask file of an option require a new run.
    n = mv.read_mesh("m2.ply").n_vertices
    for shift, expected in ((0.0, ["m2"]), (0.0, []), (0.3, ["m2"])):
        np.savetxt("mask.csv", np.arange(n) / n + shift, header="mask", comments="")
        capsys.readouterr()
        masked = ["--mask", "mask.csv>0.5", "-o", "masked/", "--resume"]
        assert main(["features", "m2.ply", "--count", "9", "--no-cache", *masked]) == 0
        assert [line[7:9] for line in capsys.readouterr().out.splitlines()] == expected


def test_a_manifest_holds_the_rows_of_all_runs(capsys: pytest.CaptureFixture[str]) -> None:
    for number in (0, 2, 0):  # into a folder with the name of the kind
        command = ["features", f"m{number}.ply", "--kind", "hks", "--count", "9", "--no-cache"]
        assert main([*command, "--resume", "-o", "hks/"]) == 0
    assert [row["output"] for row in rows("hks/manifest_features.parquet")] == ["m0.npz", "m2.npz"]
    assert "1 of 1 mesh done, 1 of them before, 0 failed" in capsys.readouterr().err
    with raises("wrong-format"):
        mv.read_maps("hks/manifest_features.parquet", mv.read_mesh("m0.ply"))
    Path("hks/manifest_features.parquet").write_text("none")
    assert main([*command, "--resume", "-o", "hks/"]) == 2
    assert "manifest_features.parquet is not a manifest" in capsys.readouterr().err


@pytest.mark.slow
def test_two_runs_at_once_write_one_manifest() -> None:
    made = "import meshmash_viewer.cli.manifest as it, sys, time; whole = it.written_whole\n"
    # Wait after reading, long enough for the other run to write.
    made += "it.written_whole = lambda path: (time.sleep(0.05), whole(path))[1]\n"
    made += "from argparse import Namespace as N; from pathlib import Path as P\n"
    made += "names = [f'{sys.argv[1]}{i}' for i in range(9)]\n"
    made += "all = [P(f'out/{each}.npz') for each in names]\n"
    made += "one = it.Manifest(all, [], N(command='features', mesh=[P(each) for each in names]))\n"
    made += "print(flush=True); input()\n"
    made += "for i in range(9): one.add([it.Outcome(i)])"
    Path("out").mkdir()
    command = [sys.executable, "-c", made]
    runs = [subprocess.Popen([*command, name], stdin=-1, stdout=-1, text=True) for name in "ab"]
    for run in runs:
        assert run.stdout is not None
        run.stdout.readline()  # This run is ready, too.
    for run in runs:
        assert run.stdin is not None
        run.stdin.write("\n")
        run.stdin.flush()
    for run in runs:
        run.communicate()
    assert [run.returncode for run in runs] == [0, 0]
    found = [Path(row["mesh"]).name for row in rows("out/manifest_features.parquet")]
    assert len(found) == len(set(found)) == 18


@pytest.mark.slow
def test_pieces_are_tasks(cluster: Any) -> None:
    mesh = shapes.blob(3)
    found = []
    with distributed.Client(cluster, set_as_default=False) as client:
        for each in (None, client):
            stitcher = mv.MeshStitcher(mesh, n_jobs=1, client=each)
            stitcher.split_mesh(200, t_max=0.02)
            hks = stitcher.apply(lambda piece: mv.compute_hks(piece, 60, t_min=0.3, t_max=0.5))
            found.append(hks.tobytes())
        assert len(stitcher) > 2
        assert found[0] == found[1]
        with pytest.raises(PieceError, match=r"piece \d of .*ZeroDivisionError"):
            stitcher.apply(lambda piece: 1 / 0)


@pytest.mark.parametrize(
    ("scheduler", "said"),
    [
        ("127.0.0.1:1", "No Dask scheduler answers at 127.0.0.1:1: give the address that `dask"),
        ("xx://there", "No Dask scheduler answers at xx://there: give"),
    ],
)
def test_no_scheduler_is_one_sentence(
    scheduler: str,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("meshmash_viewer.cli.cluster._ANSWER", 0.5)
    assert features("out", "--scheduler", scheduler) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not Path("out").exists()


def test_without_the_package_it_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert features("out", "--scheduler", "local:2") == 2
    assert 'pip install "meshmash-viewer[cluster]"' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        features("out", "--scheduler", "local:none")
    assert "is not local:N" in capsys.readouterr().err


CONDENSE = ["condense", "m0.ply", "m2.ply", "--t-min", "0.3", "--t-max", "1", "--max-eigenvalue"]
CONDENSE += ["20", "--min-vertices", "20", "-o", "out/", "--graphs", "graphs/"]
POINTS = ["points", "m0.ply", "--points", "points.csv", "-o", "out/points.csv"]


@pytest.mark.slow
def test_condense_and_points_take_the_same_options(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("fast_simplification")
    Path("points.csv").write_text("id,x,y,z\n1,0,0,1\n")
    for command, count in ((CONDENSE, 2), (POINTS, 1)):
        for kept in (0, count):
            assert main([*command, "--resume"]) == 0
            said = capsys.readouterr()
            assert len(said.out.splitlines()) == count - kept
        assert f"{count} of them before, 0 failed; manifest: " in said.err
    Path("graphs/m0.npz").unlink()
    assert main([*CONDENSE, "--resume"]) == 0
    assert capsys.readouterr().out.startswith("out/m0.npz")


def test_the_script_for_slurm_starts_a_command_that_exists(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = Path(__file__).parents[1] / "docs" / "how_to" / "thousand_neurons.md"
    script = page.read_text(encoding="utf-8").partition("## With Slurm")[2]
    script = script.partition("```py\n")[2].partition("```")[0]
    Path("ids.txt").write_text("12\n34\n")
    made, called = [], []

    class SLURMCluster:
        scheduler_address = "tcp://login:8786"

        def __init__(self, **options: Any) -> None:
            made.append(options)

        def scale(self, jobs: int) -> None:
            made.append(jobs)

        def close(self) -> None:
            made.append("closed")

    def run(command: list[str]) -> subprocess.CompletedProcess[str]:
        called.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=SLURMCluster))
    monkeypatch.setattr(subprocess, "run", run)
    exec(compile(script, str(page), "exec"), {})
    assert [each for each in made if isinstance(each, (int, str))] == [100, "closed"]
    ((program, *arguments),) = called
    assert program == "meshmash-viewer"
    options = parsed_command(arguments)
    assert options.mesh == [Path("meshes/12.ply"), Path("meshes/34.ply")]
    assert (options.command, options.scheduler) == ("predict", SLURMCluster.scheduler_address)
    assert options.resume


def at_first(file: str, act: Callable[[], None]) -> threading.Thread:
    """Call `act` in a thread once a file matches."""

    def wait() -> None:
        while not list(Path().glob(file)):
            time.sleep(0.05)
        act()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_lost_worker_costs_its_tasks_only(
    cluster: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("m1_bad.ply").unlink()
    for number in range(8):
        save(number, 3)
    at_the_time: list[int] = []

    def kill() -> None:
        at_the_time.append(len(list(Path("there").glob("*.npz"))))
        os.kill(cluster.workers[0].pid, signal.SIGKILL)

    killer = at_first("there/*.npz", kill)
    assert features("there", "--scheduler", cluster.scheduler_address) == 0
    killer.join()
    assert at_the_time[0] < 8
    assert "8 of 8 meshes done, 0 failed" in capsys.readouterr().err
    assert features("here", "--jobs", "1") == 0
    check_same("here", "there", 8)


@pytest.mark.slow
def test_a_run_whose_scheduler_is_killed_is_resumed_by_processes_of_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("m1_bad.ply").unlink()
    for number in range(8):
        save(number, 3)
    with subprocess.Popen(
        [sys.executable, "-c", ALONE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as alone:
        assert alone.stdout is not None
        address = alone.stdout.readline().strip()
        killer = at_first("there/manifest_*", alone.kill)
        assert features("there", "--scheduler", address) == 2
        killer.join()
    *_, last, lost = capsys.readouterr().err.splitlines()
    assert "The scheduler was lost after" in lost
    assert "--resume" in lost
    done = len(rows("there/manifest_features.parquet"))
    assert f"{done} of 8 meshes done, 0 failed" in last
    assert 0 < done < 8
    assert features("there", "--resume", "--scheduler", "local:2") == 0
    said = capsys.readouterr()
    assert f"8 of 8 meshes done, {done} of them before" in said.err
    assert "dashboard: http://127.0.0.1:" in said.err
    assert len(said.out.splitlines()) == 8 - done
    assert features("here", "--jobs", "1") == 0
    check_same("here", "there", 8)
