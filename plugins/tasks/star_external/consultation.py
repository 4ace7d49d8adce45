"""A step's consultation of a planner that is installed, which runs in this process."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint

from star_core import ContractError, Estimate, Health, PluginError, Scene, StarError
from star_external.goals import GOAL_KEYS, checked
from star_external.planner import Answer, Done, ExternalPlanner, Failed, Goal
from star_external.rates import ticks_between
from star_external.words import quoted, reason


class Consultation:
    """Asks a planner once a tick, or at a rate, and answers for nothing that it does.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents that the planner is made for.
        point: Names what makes it.
        rate: Questions a second, 1/s; None for one a tick.

    Raises:
        PluginError: The planner cannot be made, and in flight: it raised, or its answer breaks the
            contract; the message names it.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], point: EntryPoint, rate: float | None = None
    ) -> None:
        self._scene = scene
        self._whom = f"external planner {point.name!r} ({_source(point)})"
        self._every = ticks_between(rate, scene.period)
        self._ticks = 0
        with self._blamed():
            self._planner = point.load()(scene, rows)
            if not isinstance(self._planner, ExternalPlanner):
                made = type(self._planner).__name__
                raise ContractError(f"made {made}, expected plan(estimate, health, rows)")

    def ask(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterator[Answer]:
        due = self._ticks % self._every == 0
        self._ticks += 1
        if due:
            with self._blamed():
                answer = self._planner.plan(estimate, health, tuple(agents.values()))
                answer = self._checked(answer, agents)
            yield answer

    def close(self) -> None:
        with self._blamed():
            getattr(self._planner, "close", lambda: None)()

    def _checked(self, answer: object, agents: Mapping[str, int]) -> Answer:
        """Return the planner's answer, if it keeps the contract."""
        match answer:
            case Done():
                return answer
            case Failed(str(why)):
                return Failed(f"{self._whom} gave up: {reason(why)}")
            case Mapping():
                given = {name: _fields(name, goal) for name, goal in answer.items()}
                return checked(given, self._scene, agents)
        raise ContractError(
            f"plan() returned {quoted(answer)}, expected goals by agent, Done() or Failed(why)"
        )

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """Name the planner in whatever is raised inside."""
        try:
            yield
        except StarError as error:
            raise PluginError(f"{self._whom}: {error}") from error
        except (Exception, SystemExit) as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            said = reason(f"{type(error).__name__}: {error}")
            raise PluginError(f"{self._whom}: {said} ({at.filename}:{at.lineno})") from error


def _source(point: EntryPoint) -> str:
    """Return where a planner comes from: its distribution, if that is known, and what is called."""
    found = point.dist
    return f"{found.name} {found.version}: {point.value}" if found else point.value


def _fields(name: str, goal: object) -> dict[str, object]:
    """Return what a goal says, as another process would say it.

    Raises:
        ContractError: It is no goal.
    """
    if not isinstance(goal, Goal):
        raise ContractError(f"{name}: the goal is {quoted(goal)}, expected a Goal")
    return {key: value for key in GOAL_KEYS if (value := getattr(goal, key)) is not None}
