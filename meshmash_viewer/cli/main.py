"""The program ``meshmash-viewer``: the window, and commands without a window.

`parsed_command` parses the options. A command is a function in the module of the same name, or in
the module that `_MODULES` states. It checks the options and calls `batch.for_each`, which reads
each mesh and prints its report. Large modules are imported after the arguments are checked. A fault
that the user can correct is reported in one line on stderr with exit status 2. A defect of the
program has status 1, and its message names a file with details. Neither stops the other meshes.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import signal
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType

from meshmash_viewer.cli.arguments import FAULT
from meshmash_viewer.cli.parser import COMMANDS, parsed_command, parsed_window
from meshmash_viewer.cli.streams import PROGRAM, answer, drop, prepare_streams, say
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.compiler import check_compiler, limit_accelerate
from meshmash_viewer.work import closed_pipe_errors

_INTERRUPTED = 130
#: Modules of commands that have no module of the same name.
_MODULES = {
    **dict.fromkeys(("info", "compare", "reconstruct", "regions"), "commands"),
    **dict.fromkeys(("train", "predict"), "classes"),
    **dict.fromkeys(("render", "gallery", "movie"), "pictures"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line, and return its exit status.

    `argv` are the arguments after the program's name, by default those of the process. The status
    is 0 for success, 1 for a defect of the program, 2 for a fault that the user can correct, and
    130 if interrupted.
    """
    prepare_streams()
    limit_accelerate(os.environ)
    try:
        with closed_pipe_errors():
            try:
                return _run(list(sys.argv[1:] if argv is None else argv))
            finally:
                sys.stdout.flush()
    except BrokenPipeError:  # the receiver has closed the pipe
        drop(sys.stdout)
        return 0
    except OSError as fault:
        drop(sys.stdout)
        say(f"The output cannot be written ({fault.strerror or fault}).")
        return FAULT


def open_window() -> int:
    """Open the window from a desktop, without a console; return the exit status.

    A message box shows errors in the arguments.
    """
    said = io.StringIO()
    if sys.stderr is None:
        sys.stderr = said
    try:
        status = main()
    except SystemExit as end:  # the parser has printed the reason
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    if status and (text := said.getvalue()):
        from meshmash_viewer.app.run import show_message

        with contextlib.suppress(InputError):  # without a display
            show_message(text.replace(f"{PROGRAM}: ", "").strip())
    return status


def _run(arguments: list[str]) -> int:
    """Run the command, print its fault if it fails, and return the exit status."""
    warnings.showwarning = lambda message, *_: say(str(message))
    from meshmash_viewer.cli.batch import expanded, linked, say_fault  # plug-ins may warn

    try:
        if arguments and arguments[0] in COMMANDS:
            run, options = _run_command, parsed_command(arguments)
        else:
            run, options = _open_window, parsed_window(arguments)
        options.mesh = expanded(linked(options))
        options.map = expanded(getattr(options, "map", ()))
        check_compiler()
        return run(options)
    except (KeyboardInterrupt, Cancelled):
        say("interrupted")
        return _INTERRUPTED
    except BrokenPipeError:
        raise
    except Exception as fault:  # noqa: BLE001  a message instead of a traceback
        return say_fault(fault)


def _run_command(options: Namespace) -> int:
    if options.n_meshes not in (None, len(options.mesh)):
        takes = "one mesh" if options.n_meshes == 1 else "two meshes"
        files = ", ".join(map(str, options.mesh[:3])) + (", …" if len(options.mesh) > 3 else "")
        remedy = "run it once for each mesh" if options.n_meshes == 1 else "name two files"
        fault = f"{options.command} takes {takes}, not {len(options.mesh)} ({files})"
        raise InputError("counts-differ", fault, remedy)
    module = _MODULES.get(options.command, options.command)
    run = getattr(importlib.import_module(f"meshmash_viewer.cli.{module}"), options.command)
    with _ended_by_sigterm():
        return int(run(options))


@contextlib.contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """End a command by SIGTERM as by Ctrl-C: otherwise its worker processes live for minutes."""
    try:
        before = signal.signal(signal.SIGTERM, _interrupt)
    except ValueError:  # only the main thread receives signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: FrameType | None) -> None:
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler):  # Ctrl-C is ignored in the background of some shells
        raise KeyboardInterrupt
    handler(number, frame)


def _open_window(options: Namespace) -> int:
    if options.info:
        from meshmash_viewer.app.view.picture import asked_graphics
        from meshmash_viewer.model.notices import system_report

        answer(system_report(asked_graphics()))
        return 0
    first = str(options.mesh[0]) if options.mesh else ""
    if first.isidentifier() and not os.path.lexists(first):
        remedy = f"the commands are {', '.join(COMMANDS[:-1])} and {COMMANDS[-1]}"
        raise InputError("unknown-name", f"There is neither a command nor a file {first}", remedy)
    from meshmash_viewer.app.run import run_app

    if options.map and not first:
        raise InputError("missing-argument", "--map needs a mesh", "give the mesh file before it")
    if others := ", ".join(map(str, options.mesh[1:])):
        say(
            f"The window opens only {first}, not {others}: open a second mesh by File > Compare"
            " with, and values per vertex by --map."
        )
    path = Path(first) if first else None
    return run_app(path, options.unit or "", options.map, fresh=options.fresh)
