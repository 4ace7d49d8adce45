"""Draws what befalls agents and parts in flight."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

AGENT_TROUBLES = (
    "silent",  # nothing is heard of it
    "deaf",  # neither setpoints nor orders reach it
    "disobedient",  # orders do not reach it
    "falls",  # its motors stop in the air
    "tumbled",  # it says so
    "flat",  # its battery is nearly empty
    "voltless",  # it does not say how its battery is
    "nowhere",  # it does not say where it is
    "unlocated",  # the localizer does not know where it is
    "unreachable",  # the planner finds no way for it
    "unplanned",  # the planner leaves it out
    "unavoided",  # the avoider leaves it out
)
PART_TROUBLES = (
    *(
        f"{part} {how}"
        for part in ("localizer", "planner", "avoider", "task")
        for how in ("raises", "answers nonsense", "answers NaN")
    ),
    "task fails",
    "task goes on",
    "task asks for all time",
    "transport raises",
)


@dataclass(frozen=True)
class Trouble:
    """Something that goes wrong for a while.

    Attributes:
        kind: One of `AGENT_TROUBLES` or `PART_TROUBLES`.
        row: Whom it befalls.
        begins: When, s.
        lasts: For how long, s.
    """

    kind: str
    row: int
    begins: float
    lasts: float

    def now(self, time: float) -> bool:
        """Whether it is so at a mission time, s."""
        return self.begins <= time < self.begins + self.lasts


def troubles(agents: int) -> st.SearchStrategy[tuple[Trouble, ...]]:
    """Up to three troubles; one of three missions has none."""
    trouble = st.builds(
        Trouble,
        st.sampled_from(AGENT_TROUBLES * 2 + PART_TROUBLES),
        st.integers(0, agents - 1),
        st.integers(1, 200).map(lambda tenths: tenths / 10),
        st.sampled_from([0.3, 2.0, 1e9, 1e9]),
    )
    some = st.lists(trouble, min_size=1, max_size=3).map(tuple)
    return st.one_of(st.just(()), some, some)
