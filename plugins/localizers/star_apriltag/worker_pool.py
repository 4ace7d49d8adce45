"""Follows agents beside the tick, in processes of their own: a tick never waits for an image.

GTSAM holds the interpreter's lock while it optimises, so threads would not do.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing import Pipe
from typing import Final

from star_apriltag.agent_estimator import Settings
from star_apriltag.agent_group import NOTHING, Group, Heard, Learnt, together
from star_core import Scene

log = logging.getLogger(__name__)

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
SERVE: Final = "from star_apriltag.process import serve; serve"
PATIENCE: Final = 5.0  # s for a process to end by itself
OLDEST: Final = 1.0  # s: a process that is later than that is spared the images before


class Beside:
    """Follows all agents of a scene.

    In lock-step, what an image says is known at the tick after the one at which it arrived, and
    waited for if need be: a flight is the same however many processes there are. Where mission
    time goes on by itself, it is known at the first tick by which it is there.

    Args:
        scene: Agents with their cameras, the map.
        settings: How to follow them.
        processes: How many to use; with 0, agents are followed within the tick.

    Attributes:
        lost: Rows of agents whose process has ended.
    """

    def __init__(self, scene: Scene, settings: Settings, processes: int) -> None:
        rows = sorted(range(len(scene.agents)), key=lambda row: scene.agents[row].camera is None)
        self.lost: list[int] = []
        self._workers: list[Here | There] = []
        self._wait = not scene.realtime
        if not processes:
            self._workers.append(Here(scene, rows, settings))
            return
        try:
            for i in range(min(processes, len(rows))):
                self._workers.append(There(scene, rows[i::processes], settings))
            for worker in self._workers if scene.realtime else ():
                worker.take(wait=True)  # so that the first images need not wait for imports
        except BaseException:
            self.close()
            raise

    def tick(self, heard: Heard) -> Learnt:
        """Take in what was heard in a tick; return what is known of earlier ones that was not."""
        learnt = together([worker.take(wait=self._wait) for worker in self._workers])
        for worker in self._workers:
            worker.give(heard)
        self.lost = [row for worker in self._workers if worker.ended for row in worker.rows]
        return learnt

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()


def suited(scene: Scene) -> int:
    """Return how many processes suit a scene and this machine.

    ``OMP_NUM_THREADS=1`` says, as it does to other libraries, that there is one core to be used.
    """
    cameras = sum(agent.camera is not None for agent in scene.agents)
    told = os.environ.get("OMP_NUM_THREADS", "")
    cores = min(_cores(), int(told) if told.isdecimal() else sys.maxsize)
    return min(cameras, max(1, cores - 1)) if cores > 1 or scene.realtime else 0


class Here:
    """Follows agents in this process."""

    ended = False

    def __init__(self, scene: Scene, rows: list[int], settings: Settings) -> None:
        self.rows = rows
        self._group = Group(scene, rows, settings)
        self._learnt = NOTHING

    def take(self, *, wait: bool) -> Learnt:
        """Return what the tick before said."""
        return self._learnt

    def give(self, heard: Heard) -> None:
        """Take in a tick."""
        self._learnt = self._group.follow(heard)

    def close(self) -> None:
        """Nothing to end."""


class There:
    """Follows agents in another process.

    It is told more only once it has answered, so that handing over never waits.

    Args:
        scene: Agents with their cameras, the map.
        rows: Of those to follow.
        settings: How to follow them.

    Attributes:
        rows: The same.
        ended: Whether the process has ended, though it should not have.

    Raises:
        OSError: The process cannot be started.
    """

    def __init__(self, scene: Scene, rows: list[int], settings: Settings) -> None:
        self.rows = rows
        self.ended = False
        self._names = scene.named(rows)
        self._late: list[Heard] = []
        self._busy = True  # it imports, and says so when it is ready
        self._connection, theirs = Pipe()
        path = os.pathsep.join(filter(None, sys.path))
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 -- this very interpreter
                [sys.executable, "-c", f"{SERVE}({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                process_group=0,  # an interrupt from the keyboard is for the flight to answer
                env=os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": path},
            )
        self._connection.send((scene, rows, settings))

    def take(self, *, wait: bool) -> Learnt:
        """Return what the ticks that it was given last said, if it has answered.

        Args:
            wait: Until it has.

        Raises:
            RuntimeError: Following failed; the message is the traceback.
        """
        if self.ended or not self._busy or not (wait or self._connection.poll()):
            return NOTHING
        try:
            answer = self._connection.recv()
        except (EOFError, OSError):
            self._end()
            return NOTHING
        self._busy = False
        if isinstance(answer, str):
            raise RuntimeError(f"following {self._names} failed:\n{answer}")  # noqa: TRY004
        for name, level, text in answer.log:
            logging.getLogger(name).log(level, "%s", text)
        learnt: Learnt = answer.learnt
        return learnt

    def give(self, heard: Heard) -> None:
        """Hand a tick over; one for which the process is not ready waits for its turn."""
        if self.ended:
            return
        self._late.append(heard.of(self.rows))
        if self._busy:
            self._late = [
                old if heard.time - old.time <= OLDEST else old._replace(sights=())
                for old in self._late
            ]
            return
        try:
            self._connection.send(self._late)
        except OSError:
            self._end()
            return
        self._late, self._busy = [], True

    def close(self) -> None:
        """End the process, in its own time if it has any sense."""
        self._connection.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _end(self) -> None:
        """Say that the process has ended."""
        self.ended = True
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(PATIENCE)
        status = self._process.returncode
        how = f"exit status {status}" if status is None or status >= 0 else _signal(-status)
        log.error("the process that follows %s has ended with %s", self._names, how)


def _cores() -> int:
    """How many cores this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _signal(number: int) -> str:
    return signal.Signals(number).name
