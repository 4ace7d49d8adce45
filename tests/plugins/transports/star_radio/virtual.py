"""A virtual clock and virtual UDP links for the radio transport.

Time passes only while the transport sleeps or waits for an answer, so a test takes no longer than
its computations, and takes the same course in every run.
"""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Self, TypeVar

import pytest

from star_radio.connection import link
from star_radio.connection.packets import LinkListener

T = TypeVar("T")
R = TypeVar("R")

EPOCH = 1000.0  # s, of the virtual clock at the start
STEP = 0.002  # s, of the virtual clock
IDLE_PERIOD = 0.1  # s, between two calls of `LinkListener.idle`
POLL_PERIOD = 0.01  # s, between two null packets of a Crazyradio


class VirtualTime:
    """The clock of a client, and the links to its drones.

    Args:
        polls: Whether open links send null packets, as a Crazyradio does 100 times a second; a link
            over UDP does not.

    Attributes:
        now: The virtual clock, s.
        polls: As given.
    """

    def __init__(self, *, polls: bool = True) -> None:
        self.now = EPOCH
        self.polls, self._polled = polls, 0.0
        self._steps = 0
        self.lock = threading.RLock()
        self._listeners: dict[str, LinkListener] = {}
        self._calls: list[tuple[float, int, Callable[[], object]]] = []  # a heap by time, s
        self._number = itertools.count()
        self._idle = 0.0

    def simulate(self) -> float:
        """Simulate a short time; return the clock after it, s."""
        self._steps += 1
        return EPOCH + self._steps * STEP

    def carry(self, uri: str, packet: bytes) -> None:
        """Carry a packet to a drone, if there is one at that address."""

    def poll(self, uri: str) -> None:
        """Carry a null packet to a drone, if there is one at that address."""

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let virtual time pass."""
        self.until(lambda: False, seconds - 1e-6)

    def until(self, done: Callable[[], object], timeout: float = 5.0) -> bool:
        """Let time pass until something is true, at most `timeout`, s; return whether it is."""
        with self.lock:
            end = self.now + timeout
            while not done():
                if self.now >= end:
                    return False
                self.advance()
            return True

    def advance(self) -> None:
        """Let a short time pass."""
        with self.lock:
            self.now = self.simulate()
            while self._calls and self._calls[0][0] <= self.now:
                heapq.heappop(self._calls)[2]()
            if self.polls and self.now - self._polled >= POLL_PERIOD - 1e-6:
                self._polled = self.now
                for uri in list(self._listeners):
                    self.poll(uri)
            if self.now - self._idle >= IDLE_PERIOD:
                self._idle = self.now
                for listener in list(self._listeners.values()):
                    listener.idle(self.now)

    def later(self, seconds: float, call: Callable[[], object]) -> None:
        """Call a function after some time."""
        heapq.heappush(self._calls, (self.now + seconds, next(self._number), call))

    def deliver(self, uri: str, packet: bytes) -> None:
        """Deliver a packet to the client of a drone."""
        if (listener := self._listeners.get(uri)) is not None:
            listener.hear(packet, self.now)

    def open(self, uri: str, listener: LinkListener) -> LinkDriver:
        """Connect a client; in place of `UdpLinks.open`."""
        self._listeners[uri] = listener
        return LinkDriver(self, uri)

    def close(self) -> None:
        """In place of `UdpLinks.close`."""

    def hang_up(self, uri: str) -> None:
        self._listeners.pop(uri, None)


class LinkDriver:
    """The client's end of a link."""

    def __init__(self, links: VirtualTime, uri: str) -> None:
        self._links, self._uri = links, uri

    def send(self, packet: bytes) -> None:
        with self._links.lock:
            self._links.carry(self._uri, packet)

    steer = send

    def close(self) -> None:
        self._links.hang_up(self._uri)


class _OneByOne:
    """In place of a pool of threads, so that a flight is the same in every run."""

    def __init__(self, _workers: int) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_raised: object) -> None:
        pass

    def map(self, act: Callable[[T], R], each: Iterable[T]) -> Iterator[R]:
        return map(act, each)


@contextmanager
def virtual(clock: VirtualTime) -> Iterator[None]:
    """Let the radio transport use a virtual clock and virtual links."""

    class Event(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            return clock.until(self.is_set, 1e9 if timeout is None else timeout)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", clock.monotonic)
        patch.setattr(time, "sleep", clock.sleep)
        patch.setattr("star_radio.connection.link.Event", Event)
        patch.setattr("star_radio.connection.udp_links.UdpLinks", lambda: clock)
        patch.setattr("star_radio.transport.ThreadPoolExecutor", _OneByOne)
        if clock.polls:  # so that echoes are as rare as those over a Crazyradio
            patch.setattr(link, "UDP_ECHO_PERIOD", link.ECHO_PERIOD)
        yield
