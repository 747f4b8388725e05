"""Error handling of commands: one line on stderr and an exit code.

The codes are 2 for invalid input (``REFUSED``), 1 for an internal error (``FAULT``), 130 for Ctrl-C
(``INTERRUPTED``), and 3 for a proof that was not reached (``NOT_PROVED``).

``_Stopped`` is the exception that a signal to stop raises.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..base.errors import RepctlError
from .terminal import clear_line, say_line

if TYPE_CHECKING:
    from ..base.certificate import Proof

REFUSED, FAULT, INTERRUPTED, NOT_PROVED = 2, 1, 130, 3


def proof_code(proof: Proof | None) -> int:
    """Return the exit code of a command: 3 if a requested proof was not reached, else 0."""
    return 0 if proof is None or proof else NOT_PROVED


class _Stopped(BaseException):
    """SIGTERM or SIGHUP as an exception of the main thread, so that clean-up code runs.

    ``number`` is the number of the signal, from which the exit code is made. The class derives from
    BaseException, so that no handler of errors catches it.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextmanager
def _stopped_cleanly() -> Iterator[None]:
    """Context manager: raise ``_Stopped`` at the first SIGTERM or SIGHUP, so that clean-up runs.

    By default these signals end the process at once. A signal that is ignored, as under nohup,
    stays ignored.
    """
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # only the main thread gets signals
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    # under nohup it is ignored
    caught = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    coming, hook = False, sys.unraisablehook

    def stop(number: int, frame: object) -> None:
        nonlocal coming
        if not coming:
            coming = True
            raise _Stopped(number)

    def swallowed(what: Any) -> None:
        """Send the signal again if Python dropped its exception.

        Python drops an exception that is raised in a finaliser, such as ``__del__``, and the signal
        would be lost. ``what`` is Python's report of the dropped exception. Reports of other
        exceptions are passed to the hook that was installed before.
        """
        nonlocal coming
        if isinstance(what.exc_value, _Stopped):
            coming = False
            threading.Timer(0.01, os.kill, (os.getpid(), what.exc_value.number)).start()
        else:
            hook(what)

    for number in caught:
        signal.signal(number, stop)
    sys.unraisablehook = swallowed
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number in caught:
            signal.signal(number, signal.SIG_DFL)


def exit_code(run: Callable[[], int], arguments: list[str], *, debug: bool) -> int:
    """Run a command; turn errors into one line on stderr and an exit code.

    Parameters
    ----------
    run
        Function that runs the command and returns its exit code.
    arguments
        Arguments of the command, quoted in the message of an internal error.
    debug
        True to show the traceback of an internal error instead of one line.
    """
    try:
        with _stopped_cleanly():
            code = run()
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk is reported here
        return code
    except RepctlError as error:
        return _say(str(error), REFUSED)
    except KeyboardInterrupt:
        return _say("interrupted; no incomplete file was left", INTERRUPTED)
    except _Stopped as stop:
        return _say(f"stopped by {stop}; no incomplete file was left", 128 + stop.number)
    except BrokenPipeError:  # the reader of our output went away, as `| head` does
        _drop_output()
        return 0
    except MemoryError:
        return _say("not enough memory; use fewer --cycles, --steps or --samples", REFUSED)
    except Exception as error:
        if debug:
            raise
        if isinstance(error, OSError) and error.strerror and error.filename is None:
            _drop_output()
            where = "the working folder" if isinstance(error, FileNotFoundError) else "the output"
            return _say(f"{error.strerror}: {where}", REFUSED)
        again = shlex.join(["repctl", "--debug", *arguments])
        what = " ".join(f"{type(error).__name__}: {error}".split())
        report = "please report it with the traceback that this command prints"
        return _say(f"internal error ({what[:200]}); {report}: {again}", FAULT)


def _say(line: str, code: int) -> int:
    """Print an error on stderr as one line, unless stderr is closed; return the given ``code``."""
    clear_line()
    try:
        say_line(f"repctl: {' '.join(line.split())}")
    except OSError:
        _drop_output()
    return code


def _drop_output() -> None:
    """Discard output that can no longer be written, for instance after ``| head`` has ended.

    Otherwise the interpreter would report the failure again at exit.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            if stream is not None and not stream.closed:
                os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
