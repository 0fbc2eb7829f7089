"""The one exception for bad input: one line, whatever the names in it are."""

from __future__ import annotations

import pickle

from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import InputError


def test_says_where_what_and_how_to_mend() -> None:
    error = InputError("312 samples exceed 250 rad/s", where="a.csv: wheel_speed_fl", mend="is it km/h?")
    assert str(error) == "a.csv: wheel_speed_fl: 312 samples exceed 250 rad/s; is it km/h?"
    assert (error.what, error.where, error.mend) == (
        "312 samples exceed 250 rad/s",
        "a.csv: wheel_speed_fl",
        "is it km/h?",
    )
    assert str(InputError("empty")) == "empty"
    assert isinstance(error, ValueError)


@given(st.text(max_size=60), st.none() | st.text(max_size=60), st.none() | st.text(max_size=60))
def test_no_text_breaks_out_of_the_line(what: str, where: str | None, mend: str | None) -> None:
    message = str(InputError(what, where=where, mend=mend))
    assert message.isprintable()
    assert len(message.splitlines()) <= 1


def test_escape_sequences_and_lines_are_defused() -> None:
    message = str(InputError("a\nb\r\nc \x1b[31mred\x1b[0m \x9b2J \u2028x\u202ey"))
    assert message == "a b c \ufffd[31mred\ufffd[0m \ufffd2J x\ufffdy"


def test_an_endless_name_keeps_the_start_and_the_mend() -> None:
    message = str(InputError("column " + "x" * 10**6, where="drive.csv", mend="rename it"))
    assert len(message) < 1010
    assert message.startswith("drive.csv: column xxx")
    assert message.endswith("x; rename it")


def test_survives_the_way_between_processes() -> None:
    error = pickle.loads(pickle.dumps(InputError("what", where="where", mend="mend")))
    assert str(error) == "where: what; mend"
    assert error.mend == "mend"
