"""What of an order is repeated so that it takes over from setpoints, without any link."""

from __future__ import annotations

import pytest

from star_core import Supervisor
from star_radio import orders
from star_radio.handover import MAX_SETPOINT_DELAY, Handover, Repeat, Report

FLIES = int(Supervisor.FLYING)
PLANNED = int(Supervisor.FLYING | Supervisor.COMMANDER_ACTIVE)
LAND, STOP = orders.land(0.0, 2.5), orders.stop()
TAKEOFF, GOTO = orders.takeoff(0.5, 1.0), orders.go_to((1, 0, 1), 0.0, 2.0, 12)
PERIOD = 0.05  # s, between two ticks


def repeated(
    order: bytes,
    *,
    height: tuple[float, float] = (0.5, 0.5),
    state: int = PLANNED,
    is_reporting: bool = True,
    confirmed: float | None = 0.0,
    seconds: float = 4.0,
    steered: bool = True,
) -> list[tuple[float, Repeat]]:
    """Give an order at 0 s; return when what is repeated.

    Args:
        order: To give.
        height: That the drone reports at 0 s and, changing evenly, 1 s later, m.
        state: That it reports.
        is_reporting: Whether it reports.
        confirmed: When the order is confirmed, s.
        seconds: For how long to look.
        steered: Whether setpoints flew it before.
    """
    handover = Handover(order, "do", 0.0, steered=steered, setpoint_at=-MAX_SETPOINT_DELAY)
    assert handover.repeat(0.0, None) is Repeat.ORDER
    repeats: list[tuple[float, Repeat]] = []
    for tick in range(1, round(seconds / PERIOD)):
        now = tick * PERIOD
        if confirmed is not None and now >= confirmed:
            handover.confirmed = confirmed
        at = height[0] + (height[1] - height[0]) * now
        what = handover.repeat(now, Report(now - 0.01, at, state) if is_reporting else None)
        if what is Repeat.ORDER and handover.confirmed is not None:
            handover.notified(now)
        if what is not Repeat.NOTHING:
            repeats.append((round(now, 2), what))
    return repeats


def last(repeats: list[tuple[float, Repeat]]) -> float:
    return repeats[-1][0] if repeats else 0.0


def test_an_order_is_held_back_until_its_time() -> None:
    handover = Handover(LAND, "land", 1.0, steered=True, setpoint_at=0.0)
    assert handover.repeat(0.95, None) is Repeat.NOTHING
    assert handover.repeat(1.0, None) is Repeat.ORDER


def test_a_landing_is_repeated_for_half_a_second() -> None:
    repeats = repeated(LAND, height=(0.5, 0.2))
    assert {what for _when, what in repeats} == {Repeat.ORDER}
    assert 0.4 <= last(repeats) <= 0.5


def test_landings_without_descent_repeat_until_the_watchdog_acts() -> None:
    repeats = repeated(LAND)
    assert 1.9 <= last(repeats) <= 2.0
    assert len(repeats) > 15


def test_late_descents_end_the_repetition_of_a_landing() -> None:
    repeats = repeated(LAND, height=(0.5, 0.4 - 1e-6))
    assert last(repeats) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("height", "state"),
    [(0.05, PLANNED), (0.5, int(Supervisor.CAN_FLY)), (0.5, FLIES | int(Supervisor.LOCKED))],
    ids=["low", "motors off", "locked"],
)
@pytest.mark.parametrize("confirmed", [0.0, None])
def test_a_drone_that_is_down_is_not_landed_again(
    height: float, state: int, confirmed: float | None
) -> None:
    assert repeated(LAND, height=(height, height), state=state, confirmed=confirmed) == []


def test_unseen_unsteered_drones_are_not_landed_again() -> None:
    assert last(repeated(LAND, is_reporting=False, confirmed=None, steered=False)) <= 1.3


def test_unseen_landings_repeat_until_the_watchdog_acts() -> None:
    assert 1.7 <= last(repeated(LAND, is_reporting=False, confirmed=None)) <= 2.0


def test_unconfirmed_landings_of_visible_drones_are_repeated() -> None:
    assert last(repeated(LAND, confirmed=None)) > 3.8


@pytest.mark.parametrize("is_reporting", [True, False])
def test_stops_repeat_until_half_a_second_after_confirmation(*, is_reporting: bool) -> None:
    repeats = repeated(STOP, is_reporting=is_reporting, confirmed=1.0)
    assert {what for _when, what in repeats} == {Repeat.ORDER}
    assert 1.4 <= last(repeats) <= 1.5


@pytest.mark.parametrize("order", [TAKEOFF, GOTO])
def test_of_other_orders_the_notification_alone_is_repeated(order: bytes) -> None:
    repeats = repeated(order)
    assert {what for _when, what in repeats} == {Repeat.NOTIFICATION}
    assert last(repeats) <= 0.5


def test_an_order_that_a_late_setpoint_cancelled_is_given_again() -> None:
    assert {what for _when, what in repeated(GOTO, state=FLIES)} == {Repeat.ORDER}
    without = repeated(GOTO, state=FLIES, steered=False)
    assert {what for _when, what in without} == {Repeat.NOTIFICATION}


def test_what_is_seen_before_an_order_is_sent_does_not_end_it() -> None:
    handover = Handover(LAND, "land", 1.0, steered=True, setpoint_at=0.0)
    assert handover.repeat(0.9, Report(0.89, 0.05, PLANNED)) is Repeat.NOTHING
    assert not handover.over
    assert handover.repeat(1.1, Report(1.09, 0.05, PLANNED)) is Repeat.ORDER


def sent(
    seconds: float,
    *,
    unheard: tuple[float, float] = (0.0, 0.0),
    answers: bool = False,
    setpoint_at: float = 0.0,
) -> list[tuple[float, Repeat]]:
    """Return what is sent to a hovering drone that setpoints flew.

    Args:
        seconds: For how long to look.
        unheard: Interval without reports, s.
        answers: Whether the drone answers, so that it is notified.
        setpoint_at: When the last setpoint was sent, s.
    """
    handover = Handover(LAND, "land", 0.0, steered=True, setpoint_at=setpoint_at)
    packets = []
    for tick in range(round(seconds / PERIOD)):
        now = tick * PERIOD
        heard = unheard[0] if unheard[0] < now <= unheard[1] else now - 0.01
        what = handover.repeat(now, Report(heard, 0.5, PLANNED))
        if what is Repeat.ORDER and answers:
            handover.confirmed = handover.confirmed or now
            handover.notified(now)
        packets.append((round(now, 2), what))
    return [packet for packet in packets if packet[1] is not Repeat.NOTHING]


def fed(packets: list[tuple[float, Repeat]]) -> list[float]:
    return [now for now, what in packets if what is Repeat.SETPOINT]


def test_unconfirmed_landings_feed_the_watchdog_and_restart() -> None:
    packets = sent(2.0)
    assert fed(packets) == pytest.approx([1.4, 1.45, 1.5])
    orders_sent = [now for now, what in packets if what is Repeat.ORDER]
    assert orders_sent[0] == pytest.approx(0.15)
    assert min(now for now in orders_sent if now > 1.4) == pytest.approx(1.65)


def test_a_landing_that_was_notified_often_is_not_fed() -> None:
    assert fed(sent(4.0, answers=True)) == []


def test_the_watchdog_is_fed_a_few_times_only() -> None:
    assert len(fed(sent(20.0))) == 9


@pytest.mark.parametrize("unheard", [(0.0, 1.7), (0.3, 6.0)])
def test_an_unheard_drone_is_not_fed(unheard: tuple[float, float]) -> None:
    """It may have rebooted, and setpoints would start its motors on the floor."""
    packets = sent(1.7, unheard=unheard, setpoint_at=-0.1)
    assert fed(packets) == []
    assert packets[-1][0] > 1.5


def test_no_setpoint_follows_a_possibly_pending_notification() -> None:
    handover = Handover(LAND, "land", 0.0, steered=True, setpoint_at=0.0)
    handover.repeat(0.15, Report(0.14, 0.5, PLANNED))
    handover.notified(1.35)
    assert handover.repeat(1.45, Report(1.44, 0.5, PLANNED)) is Repeat.ORDER
    assert handover.repeat(1.5, Report(1.49, 0.5, PLANNED)) is Repeat.SETPOINT
