"""Commands run in the process of the test."""

from __future__ import annotations

import pytest

from meshmash_viewer.cli import main as cli


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run a command; return its status, output and messages."""
    try:
        status = cli.main([str(argument) for argument in arguments])
    except SystemExit as leaving:
        status = int(leaving.code or 0)
    out, err = capsys.readouterr()
    return status, out, err


def refused(capsys: pytest.CaptureFixture[str], words: str, *arguments: object) -> None:
    """Assert that a command ends with status 2 and one sentence that contains some words."""
    status, out, err = run(capsys, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1), err
    assert words in err
