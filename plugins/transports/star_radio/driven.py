"""A link over whatever cflib has a driver for: radio, USB, TCP.

cflib's drivers are used and nothing above them: no thread per request, nothing that blocks the
tick, no setpoint when a link is closed (which locks a drone that has just landed).
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from typing import Any, Final

import cflib.crtp
from cflib.crtp.crtpstack import CRTPPacket

from star_core import PluginError
from star_radio.outbox import Outbox
from star_radio.quiet import end
from star_radio.wire import Ear

log = logging.getLogger(__name__)

POLL: Final = 0.1  # s, how long a reader waits before it looks whether it should end
BREATH: Final = 0.05  # s, by which a driver that fails is held up, else it fails without a pause
ENDED: Final = 2.0  # s of silence, in spite of echoes, after which a TCP connection is given up
CLOSES: Final = 1.5  # s, after which a driver is left to close by itself


class Driven:
    """A driver of cflib's, a thread that reads from it, and one that sends.

    Args:
        uri: Of any kind that cflib has.
        name: Of the agent.
        ear: Told what comes.
        patience: How long opening may take, s; over TCP cflib would wait for minutes.

    Raises:
        PluginError: There is no driver for the address, no dongle, or nobody there.
    """

    def __init__(self, uri: str, name: str, ear: Ear, patience: float) -> None:
        self._uri, self._ear = uri, ear
        self._closing = False
        self._sending = threading.Lock()
        self._sender = 0  # thread that sends now
        self._ends = uri.startswith("tcp://")  # cflib does not notice when
        self._driver: Any = self._open(patience)
        self._outbox = Outbox(self._send, name)
        self._reader = threading.Thread(target=self._read, name=f"star-radio-{name}", daemon=True)
        self._reader.start()
        self._outbox.start()

    def send(self, packet: bytes) -> None:
        self._outbox.order(packet)

    def steer(self, setpoint: bytes) -> None:
        self._outbox.steer(setpoint)

    def close(self) -> None:
        if self._closing:
            return
        self._closing = True
        self._outbox.stop()
        driver, self._driver = self._driver, None
        if driver is not None:
            ending = threading.Thread(target=self._end, args=(driver,), daemon=True)
            ending.start()
            ending.join(CLOSES)
        self._reader.join(2 * POLL)

    def _open(self, patience: float) -> Any:
        if not cflib.crtp.CLASSES:
            cflib.crtp.init_drivers()
        found: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._start, args=(found,), daemon=True).start()
        try:
            driver = found.get(timeout=patience)
        except queue.Empty:
            self._closing = True
            raise PluginError(f"{self._uri}: not opened in {patience:g} s") from None
        if isinstance(driver, Exception):
            raise PluginError(f"{self._uri}: {driver}") from driver
        if driver is None:
            raise PluginError(f"cflib has no driver for {self._uri!r}")
        return driver

    def _start(self, found: queue.Queue[Any]) -> None:
        """Open the driver, which may take long; close it if nobody waits any more."""
        try:
            driver = cflib.crtp.get_link_driver(self._uri, self._ear.note_quality, self._complain)
        except Exception as error:  # noqa: BLE001 -- drivers raise what they like
            found.put(error)
            return
        found.put(driver)
        if self._closing and driver is not None:
            driver.close()

    def _end(self, driver: Any) -> None:
        try:
            end(driver)
        except Exception as error:  # noqa: BLE001 -- the others are to be closed all the same
            log.debug("%s: %s", self._uri, error)

    def _send(self, packet: bytes) -> None:
        driver = self._driver
        if driver is None:
            return
        wire = CRTPPacket(packet[0], packet[1:])
        with self._sending:
            self._sender = threading.get_ident()
            try:
                driver.send_packet(wire)
            except Exception as error:  # noqa: BLE001 -- one link must not stop the others
                if self._driver is driver:  # else it has just been closed
                    self._complain(str(error))
            finally:
                self._sender = 0

    def _read(self) -> None:
        """Take packets in until the link is closed; runs in a thread of its own."""
        heard = time.monotonic()
        while not self._closing:
            driver = self._driver
            if driver is None:
                return
            packet = driver.receive_packet(POLL)
            now = time.monotonic()
            self._ear.idle(now)
            if packet is not None:
                heard = now
                self._ear.hear(bytes([packet.header]) + packet.data, now)
            elif self._ends and now - heard > ENDED:
                self._driver = None
                self._complain("the connection is gone")
                self._end(driver)
                return

    def _complain(self, message: str) -> None:
        """Pass on what a driver complains of, in whose thread this runs."""
        self._ear.complain(message)
        if threading.get_ident() != self._sender:
            time.sleep(BREATH)
