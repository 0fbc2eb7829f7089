"""The hand-written C as a program to be timed."""

from __future__ import annotations

from benchmarks.peers.native import FLAGS, Native
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program


def program(problem: Problem) -> Program:
    """The C loop over the log.

    Raises:
        FileNotFoundError: no C compiler.
    """
    note = "hand-written for this one problem, `cc " + " ".join(FLAGS[:2]) + "`"
    return Program(Native(problem), lambda out: out[0], problem.steps, note=note)
