"""How many packets a Crazyradio carries, and whether that is enough for a swarm.

A Crazyradio asks: each packet up may bring one packet down. So an agent takes as many exchanges as
it is sent setpoints or as it sends reports, whichever are more. Half of what a dongle carries is
left for retries, orders and parameters.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from star_radio.address import RadioAddress

CAPACITY: Mapping[str, int] = {"legacy": 300, "inline": 1370}
"""Exchanges with several agents in 1 s. Legacy: 2.5 ms to tune and 0.7 ms to exchange, as told in
issue 9 of bitcraze/crazyradio2-firmware; inline: what its issue 23 has for three drones with
firmware 5.1. Nothing of this was measured here."""

SLOWER: Mapping[str, float] = {"2M": 0.0, "1M": 0.33e-3, "250K": 2.3e-3}
"""By how much an exchange takes longer than at 2M, s: two packets of at most 329 bits each
(preamble, address, control field, 32 bytes, CRC: Enhanced ShockBurst)."""

SHARE = 0.5  # of the capacity that may be planned with
FASTEST = 0.01  # s, between two reports: the estimator's own period
SLOWEST = 0.1  # s, between two reports: five are to be lost before an agent counts as lost


def shared(uris: Iterable[str]) -> Counter[str]:
    """Return how many agents each dongle serves.

    >>> shared(["radio://0/80/2M/E7E7E7E701", "udp://127.0.0.1:19850"])
    Counter({'0': 1})
    """
    found = (RadioAddress.of(uri) for uri in uris)
    return Counter(radio.dongle for radio in found if radio)


def report_period(uris: Iterable[str], mode: str) -> float:
    """Return how often agents can report, as the time between two reports, s.

    >>> report_period([f"radio://0/80/2M/E7E7E7E70{i}" for i in range(4)], "legacy")
    0.03
    """
    uris = list(uris)
    shared_out = max(_rounds(uris, mode).values(), default=0.0) / SHARE
    alone = max((pause for _uri, pause in _limited(uris, mode)), default=0.0)
    tens = max(shared_out, alone) / FASTEST
    return round(max(1, math.ceil(tens - 1e-9)) * FASTEST, 2)


def overloads(uris: Iterable[str], mode: str, tick: float, report: float | None) -> Iterator[str]:
    """Say which dongles and which links cannot serve their agents, with the arithmetic.

    Args:
        uris: Of every agent.
        mode: Of the dongles: a key of `CAPACITY`.
        tick: Time between two setpoints, s.
        report: Time between two reports, s; None as often as can be.
    """
    uris = list(uris)
    rounds = _rounds(uris, mode)
    between = report or min(SLOWEST, report_period(uris, mode))
    each = max(1 / tick, 1 / between)
    for uri, pause in _limited(uris, mode):
        if 1 / pause < each * (1 - 1e-9):
            yield (
                f"{uri!r} can carry {_shown(1 / pause)} exchanges/s, and is to carry "
                f"{_shown(each)} ({_shown(1 / tick)} setpoints/s up, {_shown(1 / between)} "
                "reports/s down): raise its rate_limit, or leave it out"
            )
    for dongle, agents in sorted(shared(uris).items()):
        capacity = agents / rounds[dongle]
        room = SHARE * capacity
        if agents * each <= room * (1 + 1e-9):
            continue
        can = math.floor(room / each + 1e-9)
        yield (
            f"dongle {dongle!r} is to serve {agents} agents with {_shown(each)} exchanges/s each "
            f"({_shown(1 / tick)} setpoints/s up, {_shown(1 / between)} reports/s down): "
            f"{_shown(agents * each)}/s, where {_shown(room)}/s may be planned, {SHARE:.0%} of the "
            f"{_shown(capacity)}/s of mode {mode!r}; it can serve {can}; "
            f"{_advice(tick, between)}"
        )


def _limited(uris: Iterable[str], mode: str) -> Iterator[tuple[str, float]]:
    """Yield each link with a ``rate_limit``, and the time from one of its exchanges to the next, s.

    cflib 0.1.34 waits for so long after each exchange (``radiodriver.py``).
    """
    for uri in uris:
        radio = RadioAddress.of(uri)
        if radio is not None and radio.most is not None:
            yield uri, 1 / radio.most + 1 / CAPACITY[mode] + SLOWER[radio.rate]


def _rounds(uris: Iterable[str], mode: str) -> Mapping[str, float]:
    """Return how long each dongle takes for one exchange with every one of its agents, s."""
    found: Counter[str] = Counter()
    for radio in filter(None, map(RadioAddress.of, uris)):
        found[radio.dongle] += 1 / CAPACITY[mode] + SLOWER[radio.rate]  # type: ignore[assignment]
    return found


def _advice(tick: float, between: float) -> str:
    """Say what takes most of a dongle's time, and what can be done about that."""
    ways = []
    if tick < between:
        most = "setpoints take"
        ways.append("lower the mission's rate")
    elif between < tick:
        most = "reports take"
        if between < SLOWEST:
            ways.append("report less often")
    else:
        most = "setpoints and reports alike take"
        if tick < SLOWEST:
            ways.append("lower the mission's rate and report less often")
    ways.append("share the agents among more dongles")
    return f"{most} the most: {', or '.join(ways)}"


def _shown(rate: float) -> str:
    return f"{rate:.1f}".removesuffix(".0")
