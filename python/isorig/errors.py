"""Errors: the words of the terminal, and its exit codes."""

from __future__ import annotations

from typing import Optional


class IsorigError(Exception):
    """What `isorig` would have said at a terminal. ``exit_code`` is the code that it would have ended with."""

    exit_code = 1


class BadInput(IsorigError):
    """A file, a model or a request is wrong; the message says where, what, and what to do."""

    exit_code = 3


class NoDaemon(IsorigError):
    """No isorigd on the socket, or the socket is not ours to open."""

    exit_code = 4


class NoAnswer(NoDaemon):
    """isorigd is there and has not answered in time: it is busy, stopped, or hangs."""


class Refused(IsorigError):
    """isorigd answers and says no: the state forbids it, a limit, an interlock.

    ``status`` is the HTTP status of its answer (docs/api.md).
    """

    exit_code = 5

    def __init__(self, message: str, status: int = 409) -> None:
        super().__init__(message)
        self.status = status


class Tripped(IsorigError):
    """A limit or a fault stopped the run: it is over, or held under pressure until a reset or an abort."""

    exit_code = 6


class DataLost(IsorigError):
    """It worked, but samples are missing; the message says how many and where."""

    exit_code = 7


def located(file: object, line: Optional[int], message: str) -> BadInput:
    """``file:line: message``, as the terminal has it."""
    return BadInput(f"{file}:{line}: {message}" if line else f"{file}: {message}")
