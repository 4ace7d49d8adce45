"""Tells when ticks come late, and which part took the time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

NAMED: Final = 2
"""Parts that are named: those that took the most."""

LEAST: Final = 1e-3
"""What took less is not named, s."""

WORDS: Final = {"safety": "safety filter"}

AGAIN: Final = 10.0
"""After one late tick is told of, the next is no sooner than so, s."""


class Lateness:
    """How late the ticks come of a flight whose time goes on by itself; elsewhere none does.

    Args:
        period: From one tick to the next, s. A tick that is later than that is one that was left
            out.
        took: How long was computed in all, s, by the kind of part; somebody else adds to it.
    """

    def __init__(self, period: float, took: Mapping[str, float]) -> None:
        self._period, self._took = period, took
        self._before = dict(took)
        self._last = 0.0  # s, when the tick before came
        self._told = -AGAIN  # s
        self._untold = 0
        self._ticks = 0
        self._worst = 0.0

    def note(self, due: float, now: float) -> str:
        """Note when a tick came, s, that was due; return what is to be told of it, if anything."""
        spent = {kind: self._took[kind] - self._before[kind] for kind in self._took}
        passed, self._last = now - self._last, now
        self._before = dict(self._took)
        late = now - due
        if late <= self._period:
            return ""
        self._ticks += 1
        self._worst = max(self._worst, late)
        if now < self._told + AGAIN:
            self._untold += 1
            return ""
        others, self._untold, self._told = self._untold, 0, now
        largest = sorted(spent.items(), key=lambda one: -one[1])[:NAMED]
        named = [f"the {WORDS.get(kind, kind)} took {s:.3f} s" for kind, s in largest if s >= LEAST]
        if (rest := passed - sum(spent.values())) > self._period:
            named.append(f"{rest:.3f} s went to tasks, observers, waiting or other programs")
        since = f"; late since the last that was told: {others}" if others else ""
        return f"a tick came {late:.3f} s late, {passed:.3f} s after the last: " + (
            ", ".join(named) + since
        )

    def summary(self) -> dict[str, float]:
        """Return what ``summary.json`` holds of it: how many, and the latest by how much, s."""
        return {"late_ticks": self._ticks, "latest_tick_s": round(self._worst, 6)}
