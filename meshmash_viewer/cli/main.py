"""The command ``meshmash-viewer``: the window, and what can be done without it.

Nothing heavy is imported before the arguments are known to be right. What the user can mend is
said in one line on stderr, with exit status 2; a defect of the program, with 1, names a file of
details. Neither holds up the other meshes of a batch.
"""

from __future__ import annotations

import os
import sys
import warnings
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from meshmash_viewer.cli.arguments import COMMANDS, command_parser, say, window_parser
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.compiler import check_compiler

__all__ = ["main"]

_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; those of the process if not given.

    Returns
    -------
    int
        Exit status: 0 well, 1 a defect of the program, 2 something the user can mend, 130
        interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    warnings.showwarning = lambda message, *_: say(str(message))
    from meshmash_viewer.cli.batch import say_fault  # now that a plug-in can complain in a line

    try:
        if arguments and arguments[0] in COMMANDS:
            run, options = _run, command_parser().parse_args(arguments)
        else:
            run, options = _open_window, window_parser().parse_args(arguments)
        check_compiler()
        return run(options)
    except (KeyboardInterrupt, Cancelled):
        say("interrupted")
        return _INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has left; Python would complain once more while closing it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as fault:  # noqa: BLE001  nobody is shown a traceback
        return say_fault(fault)


def _run(options: Namespace) -> int:
    from meshmash_viewer.cli import commands, pictures

    named = {
        "info": commands.info,
        "features": commands.features,
        "compare": commands.compare,
        "reconstruct": commands.reconstruct,
        "render": pictures.render,
        "gallery": pictures.gallery,
        "movie": pictures.movie,
    }
    return named[options.command](options)


def _open_window(options: Namespace) -> int:
    if options.info:
        from meshmash_viewer.app.view.graphics import asked_graphics
        from meshmash_viewer.model.system_report import system_report

        print(system_report(asked_graphics()))
        return 0
    first = options.mesh[0] if options.mesh else ""
    if first.isidentifier() and not os.path.lexists(first):
        raise InputError(
            f"There is neither a command nor a file {first}; the commands are"
            f" {', '.join(COMMANDS[:-1])} and {COMMANDS[-1]}."
        )
    from meshmash_viewer.app.run import run_app

    if options.map and not first:
        raise InputError("--map is of a mesh: name the mesh file before it.")
    path = Path(first) if first else None
    return run_app(path, options.unit or "", options.map, fresh=options.fresh)
