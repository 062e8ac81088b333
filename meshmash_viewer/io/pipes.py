"""Pipes that are no longer read: one test for what each operating system answers then."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator

#: Of POSIX; and of Windows, whose C library has no better word for ERROR_NO_DATA.
_CLOSED = (errno.EPIPE, errno.EINVAL)


def is_closed_pipe(fault: BaseException) -> bool:
    """Whether writing to a pipe failed because its other end has been closed.

    Parameters
    ----------
    fault : BaseException
        What writing to a pipe, flushing it or closing it raised. On Windows that is ``EINVAL``,
        which means other things where it comes with the name of a file.
    """
    if isinstance(fault, BrokenPipeError):
        return True
    return isinstance(fault, OSError) and fault.errno in _CLOSED and fault.filename is None


@contextlib.contextmanager
def closed_pipe_errors() -> Iterator[None]:
    """Raise `BrokenPipeError`, on every operating system, where the other end has been closed.

    Only what writes to a pipe, flushes it or closes it belongs into the body.

    Raises
    ------
    BrokenPipeError
        Instead of another `OSError` that means the same.
    """
    try:
        yield
    except OSError as fault:
        if is_closed_pipe(fault) and not isinstance(fault, BrokenPipeError):
            raise BrokenPipeError(errno.EPIPE, "the other end of the pipe is closed") from fault
        raise
