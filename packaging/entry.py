"""What the stand-alone program starts with: the command line, or Python for its own processes.

Processes of the solver, of readers and of the window are started as ``sys.executable -c …``,
``-m …`` or with a file. In a bundle that is the program itself, which has to be Python for them.
"""

from __future__ import annotations

import runpy
import sys

#: Flags of Python that an embedded interpreter has no use for; the second kind has a value.
_FLAGS, _VALUED = ("-P", "-I", "-B", "-E", "-s", "-S", "-u", "-O"), ("-W", "-X")


def _as_python(arguments: list[str]) -> bool:
    """Do what Python does with these arguments, if they are Python's."""
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
