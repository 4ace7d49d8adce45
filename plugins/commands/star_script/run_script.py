"""Runs a script beside its flight, and lands all agents when it ends."""

from __future__ import annotations

import runpy
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from star_core import Mission, Operator, Registry, StarError, open_flight
from star_script.modules import provided
from star_script.script_flight import ScriptFlight


def run_script(
    script: Path,
    arguments: Sequence[str],
    mission: Mission,
    registry: Registry,
    operator: Operator,
    *,
    folder: Path | None = None,
    button: float = 2.0,
) -> tuple[dict[str, Any], bool]:
    """Run a script with a flight of a mission's swarm.

    Args:
        script: Its file.
        arguments: Of its command line.
        mission: Its agents, world, plugins and rules.
        registry: Of its plugins.
        operator: Controls of the flight.
        folder: For the record.
        button: Mission time after which a button is pressed that the script waits for, s.

    Returns:
        The flight's summary, and whether the script failed.
    """
    with open_flight(mission, registry, folder=folder, operator=operator) as flight:
        control = ScriptFlight(flight, mission, operator.report)
        script_run = _ScriptRun(script, arguments)
        with provided(control, button, script.resolve().parent), script_run.catching():
            if control.realtime:
                thread = threading.Thread(target=script_run, name="script", daemon=True)
                thread.start()
                control.serve(thread)
                thread.join(timeout=1.0)
            else:
                script_run()
            control.end()
        if not flight.over:
            control.send_parameters()  # those set at its end
        if script_run.failure and not flight.over:
            operator.report("failure", script_run.failure)
            flight.fail(script_run.failure)
    return flight.close(), bool(script_run.failure)


class _ScriptRun:
    """One run of a script.

    Attributes:
        failure: Why it failed; empty if it did not.
    """

    def __init__(self, script: Path, arguments: Sequence[str]) -> None:
        self._script, self._arguments = script.resolve(), arguments
        self.failure = ""
        self._ended = False

    def __call__(self) -> None:
        """Run the script as a program, which ends with its last thread."""
        others = {*threading.enumerate()}
        try:
            with _program(self._script, self._arguments):
                runpy.run_path(str(self._script), run_name="__main__")
                for thread in {*threading.enumerate()} - others:
                    if not thread.daemon:
                        thread.join()
        except SystemExit as end:
            if end.code not in {None, 0}:
                self.failure = f"{self._script.name} exited with {end.code}"
        except Exception as error:  # noqa: BLE001 -- whatever a script raises
            self._fail(error)
        self._ended = True

    @contextmanager
    def catching(self) -> Iterator[None]:
        """Let the script fail because of errors in threads that it starts."""
        before, threading.excepthook = threading.excepthook, self._fail_in_thread
        try:
            yield
        finally:
            threading.excepthook = before

    def _fail_in_thread(self, raised: threading.ExceptHookArgs) -> None:
        files = [Path(frame.filename) for frame in traceback.extract_tb(raised.exc_traceback)]
        if raised.exc_value is None or self._script.parent not in {file.parent for file in files}:
            threading.__excepthook__(raised)
        elif not self._ended:  # else it is left behind
            self._fail(raised.exc_value)

    def _fail(self, error: BaseException) -> None:
        """Fail because of an error; the first is the reason."""
        text = str(error)
        if not isinstance(error, StarError):
            text = f"{self._line(error)}: {type(error).__name__}: {error}"
            sys.stderr.writelines(traceback.format_exception(error, chain=False))
        self.failure = self.failure or text

    def _line(self, error: BaseException) -> str:
        """Return the last line of the script that an error passed: ``file:line``."""
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f.lineno for f in frames if f.filename == str(self._script)]
        return f"{self._script.name}:{lines[-1]}" if lines else self._script.name


@contextmanager
def _program(script: Path, arguments: Sequence[str]) -> Iterator[None]:
    """Let a script find its arguments, and modules beside it, as it does when Python runs it."""
    before, path = sys.argv, [*sys.path]
    sys.argv = [str(script), *arguments]
    sys.path.insert(0, str(script.parent))
    try:
        yield
    finally:
        sys.argv, sys.path[:] = before, path
