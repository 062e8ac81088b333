"""Entry point of the stand-alone program: the command line, or Python for its own processes.

Processes of the solver, of readers and of the window are started as ``sys.executable -c …``,
``-m …`` or with a file. In a bundle ``sys.executable`` is the program, which then acts as Python.
"""

from __future__ import annotations

import runpy
import sys

#: Flags of Python that are skipped, without and with a value.
_FLAGS, _VALUED = ("-P", "-I", "-B", "-E", "-s", "-S", "-u", "-O"), ("-W", "-X")


def _as_python(arguments: list[str]) -> bool:
    """Run arguments of Python as Python does; return False for other arguments."""
    while arguments and (arguments[0] in _FLAGS or arguments[0][:2] in _VALUED):
        flag = arguments.pop(0)
        if flag in _VALUED:
            arguments.pop(0)
    if not arguments:
        return False
    first, *rest = arguments
    if first == "-c":
        sys.argv = ["-c", *rest[1:]]
        exec(rest[0], {"__name__": "__main__"})
    elif first == "-m":
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif first.endswith(".py"):
        sys.argv = arguments
        runpy.run_path(first, run_name="__main__")
    else:
        return False
    return True


if __name__ == "__main__" and not _as_python(sys.argv[1:]):
    from meshmash_viewer.cli.main import main

    sys.exit(main())
