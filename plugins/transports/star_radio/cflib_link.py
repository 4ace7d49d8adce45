"""Link through a cflib driver: radio, USB or TCP.

Only cflib's drivers are used, none of its higher layers: no thread per request, nothing that blocks
the tick, and no setpoint when a link is closed (which locks a drone that has just landed).
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
from star_radio.cflib_silencing import close_driver
from star_radio.link_protocol import LinkListener
from star_radio.send_queue import SendQueue

log = logging.getLogger(__name__)

POLL_PERIOD: Final = 0.1  # s, between checks whether the reader should end
ERROR_PAUSE: Final = 0.05  # s, by which a failing driver is slowed: it would report without pause
TCP_TIMEOUT: Final = 2.0  # s without a packet, despite echoes: the TCP connection is closed
CLOSE_TIMEOUT: Final = 1.5  # s, after which a driver is left to close on its own


class CflibLink:
    """A cflib driver with a thread for receiving and one for sending.

    Args:
        uri: Address of any kind that cflib supports.
        name: Name of the agent.
        listener: Receiver of packets and errors.
        timeout: For opening, s; over TCP cflib would wait for minutes.

    Raises:
        PluginError: There is no driver for the address, no dongle, or no answer.
    """

    def __init__(self, uri: str, name: str, listener: LinkListener, timeout: float) -> None:
        self._uri, self._listener = uri, listener
        self._closing = False
        self._sending = threading.Lock()
        self._sender = 0  # thread that is sending
        self._may_end = uri.startswith("tcp://")  # cflib does not notice the end of a connection
        self._driver: Any = self._open(timeout)
        self._queue = SendQueue(self._send, name)
        self._reader = threading.Thread(target=self._read, name=f"star-radio-{name}", daemon=True)
        self._reader.start()
        self._queue.start()

    def send(self, packet: bytes) -> None:
        self._queue.order(packet)

    def steer(self, setpoint: bytes) -> None:
        self._queue.steer(setpoint)

    def close(self) -> None:
        if self._closing:
            return
        self._closing = True
        self._queue.stop()
        driver, self._driver = self._driver, None
        if driver is not None:
            ending = threading.Thread(target=self._end, args=(driver,), daemon=True)
            ending.start()
            ending.join(CLOSE_TIMEOUT)
        self._reader.join(2 * POLL_PERIOD)

    def _open(self, timeout: float) -> Any:
        if not cflib.crtp.CLASSES:
            cflib.crtp.init_drivers()
        found: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._start, args=(found,), daemon=True).start()
        try:
            driver = found.get(timeout=timeout)
        except queue.Empty:
            self._closing = True
            raise PluginError(f"{self._uri}: not opened in {timeout:g} s") from None
        if isinstance(driver, Exception):
            raise PluginError(f"{self._uri}: {driver}") from driver
        if driver is None:
            raise PluginError(f"cflib has no driver for {self._uri!r}")
        return driver

    def _start(self, found: queue.Queue[Any]) -> None:
        """Open the driver, which may take long; close it if the link was closed meanwhile."""
        try:
            driver = cflib.crtp.get_link_driver(
                self._uri, self._listener.note_quality, self._complain
            )
        except Exception as error:  # noqa: BLE001 -- drivers raise any type
            found.put(error)
            return
        found.put(driver)
        if self._closing and driver is not None:
            driver.close()

    def _end(self, driver: Any) -> None:
        try:
            close_driver(driver)
        except Exception as error:  # noqa: BLE001 -- the other links must still be closed
            log.debug("%s: %s", self._uri, error)

    def _send(self, packet: bytes) -> None:
        driver = self._driver
        if driver is None:
            return
        crtp_packet = CRTPPacket(packet[0], packet[1:])
        with self._sending:
            self._sender = threading.get_ident()
            try:
                driver.send_packet(crtp_packet)
            except Exception as error:  # noqa: BLE001 -- one link must not stop the others
                if self._driver is driver:  # not closed meanwhile
                    self._complain(str(error))
            finally:
                self._sender = 0

    def _read(self) -> None:
        """Receive packets until the link is closed; runs in its own thread."""
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
        """Pass on a driver's error message; runs in the driver's thread."""
        self._listener.complain(message)
        if threading.get_ident() != self._sender:
            time.sleep(ERROR_PAUSE)
