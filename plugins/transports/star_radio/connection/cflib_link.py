"""Link through a cflib driver: radio, USB or TCP.

Only cflib's drivers are used, none of its higher layers: no thread per request, nothing that blocks
the tick, and no setpoint when a link is closed (which locks a drone that has just landed).
"""

from __future__ import annotations

import logging
import queue
import threading
import time
import warnings
from collections import deque
from contextlib import suppress
from importlib import import_module
from typing import Any, Final

import cflib.crtp
from cflib.crtp.crtpstack import CRTPPacket

from star_core import PluginError
from star_radio.connection.packets import LinkListener

log = logging.getLogger(__name__)

POLL_PERIOD: Final = 0.1  # s, between checks whether the reader should end
ERROR_PAUSE: Final = 0.05  # s, by which a failing driver is slowed: it would report without pause
TCP_TIMEOUT: Final = 2.0  # s without a packet, despite echoes: the TCP connection is closed
CLOSE_TIMEOUT: Final = 1.5  # s, after which a driver closes on its own
DRAIN_TIMEOUT: Final = 0.5  # s, for sending what is queued when a link is closed
PRINTING_MODULES: Final = ("cflib.cpx.transports", "cflib.crtp.radiodriver", "cflib.crtp.tcpdriver")
TRACEBACK_MODULE: Final = "cflib.cpx"  # prints one when a link is closed, and repeatedly when lost


class CflibLink:
    """A cflib driver with a thread for receiving and one for sending.

    Args:
        uri: Address of any kind that cflib supports.
        name: Name of the agent.
        listener: Receiver of packets and errors.
        timeout: For opening, s; over TCP cflib would wait for minutes.
    """

    def __init__(self, uri: str, name: str, listener: LinkListener, timeout: float) -> None:
        self._uri, self._listener = uri, listener
        self._closing = False
        self._complaining = threading.local()
        self._may_end = uri.startswith("tcp://")  # cflib does not notice the end of a connection
        self._driver: Any = self._open(timeout)
        self._packets: deque[bytes] = deque()
        self._setpoint: bytes | None = None
        self._changed = threading.Condition()
        self._threads = [
            threading.Thread(target=work, name=f"star-radio-{name}", daemon=True)
            for work in (self._write, self._read)
        ]
        for thread in self._threads:
            thread.start()

    def send(self, packet: bytes) -> None:
        with self._changed:
            self._packets.append(packet)
            self._setpoint = None
            self._changed.notify()

    def steer(self, setpoint: bytes) -> None:
        with self._changed:
            self._setpoint = setpoint
            self._changed.notify()

    def close(self) -> None:
        if self._closing:
            return
        with self._changed:
            self._closing = True
            self._changed.notify()
        writer, reader = self._threads
        writer.join(DRAIN_TIMEOUT)
        driver, self._driver = self._driver, None
        if driver is not None:
            ending = threading.Thread(target=self._end, args=(driver,), daemon=True)
            ending.start()
            ending.join(CLOSE_TIMEOUT)
        reader.join(2 * POLL_PERIOD)

    def _open(self, timeout: float) -> Any:
        if not cflib.crtp.CLASSES:
            cflib.crtp.init_drivers()
        drivers: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._start, args=(drivers,), daemon=True).start()
        try:
            driver = drivers.get(timeout=timeout)
        except queue.Empty:
            self._closing = True
            text = f"{self._uri}: not opened in {timeout:g} s"
            raise PluginError(text, "no-answer") from None
        if isinstance(driver, Exception):
            raise PluginError(f"{self._uri}: {driver}", "link-failed") from driver
        if driver is None:
            raise PluginError(f"cflib has no driver for {self._uri!r}", "invalid-address")
        return driver

    def _start(self, drivers: queue.Queue[Any]) -> None:
        """Open the driver, which may take long; close it if the link was closed meanwhile."""
        try:
            driver = cflib.crtp.get_link_driver(
                self._uri, self._listener.note_quality, self._complain
            )
        except Exception as error:  # noqa: BLE001 -- drivers raise any type
            drivers.put(error)
            return
        drivers.put(driver)
        if self._closing and driver is not None:
            driver.close()

    def _end(self, driver: Any) -> None:
        try:
            close_driver(driver)
        except Exception as error:  # noqa: BLE001 -- the other links must still be closed
            log.debug("%s: %s", self._uri, error)

    def _write(self) -> None:
        """Send queued packets in order, and the latest setpoint after them; runs in a thread."""
        while (packet := self._next()) is not None:
            driver = self._driver
            if driver is None:
                return
            self._complaining.sends = True
            try:
                driver.send_packet(CRTPPacket(packet[0], packet[1:]))
            except Exception as error:  # noqa: BLE001 -- one link must not stop the others
                if self._driver is driver:  # not closed meanwhile
                    self._complain(str(error))

    def _next(self) -> bytes | None:
        """Wait for the next packet to send; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._packets or self._setpoint or self._closing)
            if self._packets:
                return self._packets.popleft()
            packet, self._setpoint = self._setpoint, None
            return packet

    def _read(self) -> None:
        """Receive packets until the link is closed; runs in a thread."""
        heard = time.monotonic()
        while not self._closing:
            driver = self._driver
            if driver is None:
                return
            packet = driver.receive_packet(POLL_PERIOD)
            now = time.monotonic()
            self._listener.idle(now)
            if packet is not None:
                heard = now
                self._listener.hear(bytes([packet.header]) + packet.data, now)
            elif self._may_end and now - heard > TCP_TIMEOUT:
                self._driver = None
                self._complain("the connection is lost")
                self._end(driver)
                return

    def _complain(self, message: str) -> None:
        """Pass on a driver's error message; slows the driver down, but not the sending thread."""
        self._listener.complain(message)
        if not getattr(self._complaining, "sends", False):
            time.sleep(ERROR_PAUSE)


def silence_cflib() -> None:
    """Turn cflib's prints into debug messages, and disable its logging and warnings.

    A module-level ``print`` shadows the built-in one, so the output of other modules is unaffected.
    """
    for name in PRINTING_MODULES:
        vars(import_module(name))["print"] = lambda *words, **_how: log.debug("cflib: %s", words)
    vars(import_module(TRACEBACK_MODULE))["print"] = lambda *_words, **_how: None
    logging.getLogger("cflib").setLevel(logging.CRITICAL)
    for message in ("The supervisor subsystem requires", "Using legacy TYPE_VELOCITY"):
        warnings.filterwarnings("ignore", message)  # packets for old firmware


def close_driver(driver: Any) -> None:
    """Close a driver and, for TCP, its socket.

    The TCP reader of cflib 0.1.34 ignores the end of the stream and reads again at once, until its
    transport has no socket.
    """
    transport = getattr(getattr(getattr(driver, "cpx", None), "_router", None), "_transport", None)
    try:
        driver.close()
    finally:
        socket = getattr(transport, "_socket", None)
        if socket is not None:
            vars(transport)["_socket"] = None
            with suppress(OSError):
                socket.close()
