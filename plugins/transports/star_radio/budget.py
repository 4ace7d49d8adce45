"""Packet budget of Crazyradios: whether their capacity is enough for a swarm.

A Crazyradio polls: each packet sent may bring one packet back. So an agent needs as many exchanges
as it is sent setpoints or sends reports, whichever are more. Half of a dongle's capacity is kept
for retries, commands and parameters.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from star_radio.address import RadioAddress

CAPACITY: Mapping[str, int] = {"legacy": 300, "inline": 1370}
"""Exchanges per second with several agents. Legacy: 2.5 ms to tune and 0.7 ms to exchange (issue 9
of bitcraze/crazyradio2-firmware); inline: three drones with firmware 5.1 (its issue 23). These
figures were not measured here."""

SLOWER: Mapping[str, float] = {"2M": 0.0, "1M": 0.33e-3, "250K": 2.3e-3}
"""Extra duration of an exchange compared to 2M, s: two packets of at most 329 bits each
(preamble, address, control field, 32 bytes, CRC: Enhanced ShockBurst)."""

SHARE = 0.5  # of the capacity
MIN_REPORT_PERIOD = 0.01  # s: the period of the on-board estimator
MAX_REPORT_PERIOD = 0.1  # s: an agent counts as lost after five missing reports


def shared(uris: Iterable[str]) -> Counter[str]:
    """Return the number of agents that share each dongle.

    >>> shared(["radio://0/80/2M/E7E7E7E701", "udp://127.0.0.1:19850"])
    Counter({'0': 1})
    """
    addresses = (RadioAddress.of(uri) for uri in uris)
    return Counter(radio.dongle for radio in addresses if radio)


def report_period(uris: Iterable[str], mode: str) -> float:
    """Return the shortest report period that all dongles can carry, s.

    >>> report_period([f"radio://0/80/2M/E7E7E7E70{i}" for i in range(4)], "legacy")
    0.03
    """
    uris = list(uris)
    shared_out = max(_rounds(uris, mode).values(), default=0.0) / SHARE
    alone = max((pause for _uri, pause in _limited(uris, mode)), default=0.0)
    tens = max(shared_out, alone) / MIN_REPORT_PERIOD
    return round(max(1, math.ceil(tens - 1e-9)) * MIN_REPORT_PERIOD, 2)


def overloads(uris: Iterable[str], mode: str, tick: float, report: float | None) -> Iterator[str]:
    """Yield a message with the arithmetic for each overloaded dongle or link.

    Args:
        uris: Addresses of all agents.
        mode: Mode of the dongles: a key of `CAPACITY`.
        tick: Time between two setpoints, s.
        report: Time between two reports, s; None for the shortest possible.
    """
    uris = list(uris)
    rounds = _rounds(uris, mode)
    between = report or min(MAX_REPORT_PERIOD, report_period(uris, mode))
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
    """Yield each link with a ``rate_limit``, and the time between its exchanges, s.

    cflib 0.1.34 pauses for the inverse of the limit after each exchange (``radiodriver.py``).
    """
    for uri in uris:
        radio = RadioAddress.of(uri)
        if radio is not None and radio.most is not None:
            yield uri, 1 / radio.most + 1 / CAPACITY[mode] + SLOWER[radio.rate]


def _rounds(uris: Iterable[str], mode: str) -> Mapping[str, float]:
    """Return the time each dongle takes for one exchange with each of its agents, s."""
    rounds: Counter[str] = Counter()
    for radio in filter(None, map(RadioAddress.of, uris)):
        rounds[radio.dongle] += 1 / CAPACITY[mode] + SLOWER[radio.rate]  # type: ignore[assignment]
    return rounds


def _advice(tick: float, between: float) -> str:
    """Return what takes most of a dongle's time, and how to reduce it."""
    ways = []
    if tick < between:
        most = "setpoints take"
        ways.append("lower the mission's rate")
    elif between < tick:
        most = "reports take"
        if between < MAX_REPORT_PERIOD:
            ways.append("report less often")
    else:
        most = "setpoints and reports alike take"
        if tick < MAX_REPORT_PERIOD:
            ways.append("lower the mission's rate and report less often")
    ways.append("share the agents among more dongles")
    return f"{most} the most: {', or '.join(ways)}"


def _shown(rate: float) -> str:
    return f"{rate:.1f}".removesuffix(".0")
