"""``roadstate manoeuvres``."""

from __future__ import annotations

from cli_case import Run

from roadstate.sim.manoeuvres import all_manoeuvres


def test_manoeuvres_lists_all(run: Run) -> None:
    end = run("manoeuvres")
    assert end.status == 0
    assert {line.split()[0] for line in end.out.splitlines() if line[:1].isalpha()} >= set(all_manoeuvres())


def test_manoeuvres_as_json(run: Run) -> None:
    found = run("manoeuvres", "--json").json
    assert set(found) == set(all_manoeuvres())
    assert found["double-lane-change"]["friction"] == 0.8
