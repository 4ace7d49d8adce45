"""Whether agents stand or fly where a step needs it, as far as that is known before the flight."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, Literal, TypeAlias

from star_core.contracts import TaskSpec
from star_core.mission_file.sound_parts import Incomplete
from star_core.mission_file.step_tree import Action, Node, Parallel, Repeat
from star_core.plugin_schema import JOIN, LEAVE

Where: TypeAlias = Literal["ground", "air", "reserve", "left"] | None
"""Of one agent: it stands, flies, is not in the mission yet, or no more; None if not known."""

STANDS: Final = 0.05  # m above the floor: who starts higher may stand on something, or fly
NEEDED: Final = {"ground": "on the ground", "air": "in the air"}
TWICE: Final = 2  # rounds of a repetition: the second begins where the first ends


def faults(
    steps: Sequence[Node],
    names: Sequence[str],
    starts: Iterable[float],
    reserve: Iterable[int],
    offer: Callable[[str], TaskSpec],
) -> list[str]:
    """Say which steps cannot succeed because agents would fly that stand, or the other way round.

    A step that may fail or end before it is done, and a verb that does not say so, leave open where
    its agents are; nothing is said of those until a verb takes them somewhere. After a step with
    another mistake in it this is not known of any agent.

    Args:
        steps: Of the mission, in order.
        names: Of the agents.
        starts: How high each of them starts, m.
        reserve: Rows of those that are not in the mission at first.
        offer: What announces a verb.

    Returns:
        Faults with their places, each once, in order.
    """
    where: list[Where] = ["ground" if height < STANDS else None for height in starts]
    for row in reserve:
        where[row] = "reserve"
    return list(dict.fromkeys(_Walk(names, where, offer).through(steps)))


class _Walk:
    """A walk through the steps, and where the agents are on it."""

    def __init__(
        self, names: Sequence[str], where: list[Where], offer: Callable[[str], TaskSpec]
    ) -> None:
        self._names = names
        self._where = where
        self._offer = offer

    def through(self, steps: Sequence[Node], *, together: bool = True) -> Iterator[str]:
        """Yield what is wrong; `together` unless every agent has steps of its own."""
        for step in steps:
            match step:
                case Action(options=Incomplete()):
                    self._where[:] = [None] * len(self._where)
                case Action():
                    yield from self._action(step, together=together)
                case Parallel(branches):
                    yield from self.through(branches, together=False)
                case Repeat(times, inner):
                    for _ in range(min(times, TWICE)):
                        yield from self.through(inner, together=together)

    def _action(self, action: Action, *, together: bool) -> Iterator[str]:
        """Say what is wrong with one step, and move its agents to where it leaves them."""
        offer, where = self._offer(action.verb), self._where
        rows = [row for row in action.rows if where[row] not in {"reserve", "left"}]
        if action.verb == JOIN:
            rows = list(action.rows)
        elif together and all(where[row] == "left" for row in action.rows):
            gone = self._named(action.rows)
            yield f"{action.place}: {action.verb} is for nobody: {gone} left the mission before"
        wrong = []
        if offer.before is not None:
            other = "ground" if offer.before == "air" else "air"
            wrong = [row for row in rows if where[row] == other]
            if wrong:
                are = "are" if len(wrong) > 1 else "is"
                yield (
                    f"{action.place}: {action.verb} needs its agents {NEEDED[offer.before]}; "
                    f"{self._named(wrong)} {are} {NEEDED[other]} here"
                )
        sure = action.on_failure == "abort" and action.until is None
        for row in rows:
            if action.verb == LEAVE:
                where[row] = "left"
            elif row in wrong:
                where[row] = None  # it was said; what it does next depends on how that is mended
            elif sure and offer.after != "same":
                where[row] = offer.after
            elif offer.after not in {offer.before, "same"} or action.on_failure == "land":
                where[row] = None

    def _named(self, rows: Sequence[int]) -> str:
        return ", ".join(self._names[row] for row in rows)
