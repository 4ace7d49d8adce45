"""Places in a mission and who holds them."""

from __future__ import annotations

from star_core.execution.assignments import Assignments


def test_at_first_everybody_holds_the_place_that_was_made_for_it_but_the_reserve() -> None:
    roster = Assignments(3, [2])
    assert roster.holders(range(3)) == {0: 0, 1: 1}
    assert roster.left().tolist() == [False, False, True]
    assert roster.place(2) is None


def test_the_place_of_a_reserve_is_not_to_be_filled() -> None:
    assert Assignments(3, [2]).vacancies() == []


def test_a_place_that_is_left_is_vacant_until_somebody_takes_it() -> None:
    roster = Assignments(3, [2])
    roster.vacate([0])
    assert roster.vacancies() == [0]
    roster.take(0, 2)
    assert (roster.vacancies(), roster.holders([0, 1]), roster.place(2)) == ([], {0: 2, 1: 1}, 0)
    assert roster.left().tolist() == [True, False, False]


def test_who_is_relieved_is_out_though_its_place_is_held() -> None:
    roster = Assignments(2, [1])
    roster.take(0, 1)
    roster.vacate([0])  # it holds no place, so nothing changes
    assert roster.holders(range(2)) == {0: 1}


def test_a_retired_place_is_not_to_be_filled_and_can_be_taken_again() -> None:
    roster = Assignments(2)
    roster.vacate([1], retire=True)
    assert (roster.vacancies(), roster.retired) == ([], {1})
    roster.take(1, 1)
    assert (roster.holders([1]), roster.retired) == ({1: 1}, set())
