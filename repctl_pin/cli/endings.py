"""How a command ends when it cannot go on: one line, and an exit code, whatever happens."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable

from ..errors import RepctlError
from .terminal import clear_line

REFUSED, FAULT, INTERRUPTED = 2, 1, 130


def told(run: Callable[[], int], arguments: list[str], *, debug: bool) -> int:
    """Run a command; what goes wrong becomes one line on stderr, and a code.

    Parameters
    ----------
    run
        The command.
    arguments
        Its words, to say how to run it again.
    debug
        Show the traceback of an unexpected error instead of the line.
    """
    try:
        code = run()
        if sys.stdout is not None:
            sys.stdout.flush()  # here a full disk can still be told
        return code
    except RepctlError as error:
        return _say(str(error), REFUSED)
    except KeyboardInterrupt:
        return _say("interrupted; nothing half-written was left", INTERRUPTED)
    except BrokenPipeError:  # the reader of our output went away, as `| head` does
        _drop_output()
        return 0
    except MemoryError:
        return _say("this takes more memory than there is; ask for less: fewer --cycles, --steps or --samples", REFUSED)
    except Exception as error:
        if debug:
            raise
        if isinstance(error, OSError) and error.strerror and error.filename is None:
            _drop_output()
            where = "the working folder" if isinstance(error, FileNotFoundError) else "the output"
            return _say(f"{error.strerror}: {where}", REFUSED)
        again = shlex.join(["repctl", "--debug", *arguments])
        what = " ".join(f"{type(error).__name__}: {error}".split())
        line = f"a fault of repctl, not yours ({what[:200]}); please report it with what this prints: {again}"
        return _say(line, FAULT)


def _say(line: str, code: int) -> int:
    """Print the line, unless stderr is closed."""
    clear_line()
    try:
        print(f"repctl: {' '.join(line.split())}", file=sys.stderr, flush=True)
    except OSError:
        _drop_output()
    return code


def _drop_output() -> None:
    """Discard pending output: the interpreter would complain about it at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            if stream is not None and not stream.closed:
                os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
