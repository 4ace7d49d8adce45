"""Take-offs that come down by themselves: their profiles are written to the drones, then started.

Where a profile cannot be written the firmware's own take-off is commanded, which hovers until
something takes over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from star_core import Supervisor
from star_radio.connection.questions import Question
from star_radio.profiles import writes
from star_radio.vehicle import Vehicle

WRITE_TIMEOUT: Final = 1.0  # s, after which a drone whose profile is not written takes off without
REPLY_TIME: Final = 0.2  # s; a report that arrives so long after a start shows its effect
ATTEMPTS: Final = 10  # to start


class Climb(NamedTuple):
    """A take-off of one drone.

    Attributes:
        order: The firmware's own command.
        profile: As by `star_radio.profiles.profile`; None to use that command.
        memory: Number of the memory to write the profile to.
    """

    order: bytes
    profile: bytes | None = None
    memory: int = 0


@dataclass(slots=True)
class _Group:
    """Drones that are to start together: their climbs, the writes of each, and when at the latest.

    Attributes:
        by: s of the computer's clock.
    """

    climbs: dict[int, Climb]
    writes: dict[int, Sequence[Question]]
    by: float

    def answered(self, row: int) -> bool:
        """Whether the profile of a drone is written, or refused, or there is none."""
        return all(write.answer is not None for write in self.writes[row])

    def written(self, row: int) -> bool:
        """Whether the profile of a drone is written."""
        writes = self.writes[row]
        return bool(writes) and all((write.answer or b"")[5:6] == b"\0" for write in writes)


@dataclass(slots=True)
class _Started:
    """A start that the drone has not reported yet: when it was sent last, s, and how often."""

    sent: float
    attempts: int = 1


class Takeoffs:
    """Take-offs that are being written or started.

    A start is repeated only if a later report shows that it had no effect: another one during the
    climb would begin a second climb from there.
    """

    def __init__(self, vehicles: Sequence[Vehicle]) -> None:
        self._vehicles = vehicles
        self._groups: list[_Group] = []
        self._started: dict[int, _Started] = {}

    def prepare(self, climbs: Mapping[int, Climb], now: float) -> None:
        """Write the profiles of drones that are to start together, at `now`, s."""
        questions: dict[int, Sequence[Question]] = {
            row: [] if climb.profile is None else writes(climb.profile, climb.memory)
            for row, climb in climbs.items()
        }
        for row, ones in questions.items():
            for question in ones:
                self._vehicles[row].link.assure(question)
        self._groups.append(_Group(dict(climbs), questions, now + WRITE_TIMEOUT))

    def drop(self, rows: Iterable[int]) -> None:
        """Forget the take-offs of drones that have begun them, or have a newer command."""
        for row in rows:
            self._started.pop(row, None)
            for group in self._groups:
                group.climbs.pop(row, None)
        self._groups = [group for group in self._groups if group.climbs]

    def due(self, now: float) -> dict[int, Climb]:
        """Return the take-offs to command at `now`, s; without profiles those not written."""
        begun: dict[int, Climb] = {}
        for group in self._groups:
            if now >= group.by or all(map(group.answered, group.climbs)):
                for row, climb in group.climbs.items():
                    written = group.written(row)
                    begun[row] = climb if written else climb._replace(profile=None)
                    if written:
                        self._started[row] = _Started(now)
                group.climbs = {}
        self._groups = [group for group in self._groups if group.climbs]
        return begun

    def missed(self, now: float) -> list[int]:
        """Return the rows of drones that did not start, and are to be sent the start again."""
        rows = []
        for row, start in self._started.items():
            report = self._vehicles[row].stream.newest
            idle = report.heard >= start.sent + REPLY_TIME
            idle &= not report.state & int(Supervisor.COMMANDER_ACTIVE)
            if idle and start.attempts < ATTEMPTS:
                start.sent, start.attempts = now, start.attempts + 1
                rows.append(row)
        return rows
