"""The hand-written C, compiled when asked for."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from benchmarks.peers.problems import Array, Problem
from benchmarks.peers.reference import Run

_SOURCES = Path(__file__).parent / "c"
_FILES = {
    "tfobe-lower-ukf": "tfobe.c",
    "friction-ukf": "friction_ukf.c",
    "friction-pf-1000": "friction_pf.c",
    "kf-2": "kf.c",
}
FLAGS = ("-O3", "-march=native", "-std=c11", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror")


class Native:
    """One problem's C program.

    Args:
        problem: what to run.
        definitions: for the compiler, such as ``-DHOISTED``.

    Raises:
        FileNotFoundError: no C compiler.
    """

    def __init__(self, problem: Problem, *definitions: str) -> None:
        compiler = shutil.which("cc")
        if compiler is None:
            raise FileNotFoundError("no C compiler (cc) found")
        self._problem = problem
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "filter.so"
            source = _SOURCES / _FILES[problem.name]
            subprocess.run([compiler, *FLAGS, *definitions, source, "-o", library, "-lm"], check=True)
            self._run = ctypes.CDLL(str(library)).run
        self._run.restype = ctypes.c_long

    def __call__(self) -> Run:
        """Run over the log."""
        p, n = self._problem, len(self._problem.q)
        means, stds = np.empty((p.steps, n)), np.empty((p.steps, n))
        x, P = p.mean.copy(), np.diag(p.std**2)
        head = [ctypes.c_long(p.steps)] + ([] if p.method == "pf" else [ctypes.c_double(p.dt)])
        extra = [ctypes.c_long(p.particles), ctypes.c_uint64(1)] if p.method == "pf" else []
        arrays = [_pointer(a) for a in (p.inputs, p.samples, p.q, p.r, x, P)]
        done = self._run(*head, *arrays, *extra, _pointer(means), _pointer(stds))
        if done != p.steps:
            raise ArithmeticError(f"the C filter lost definiteness at step {done}")
        return means, stds


def _pointer(array: Array) -> ctypes.c_void_p:
    if not (array.flags.c_contiguous and array.dtype == np.float64):
        raise ValueError("C wants contiguous float64")
    return ctypes.c_void_p(array.ctypes.data)
