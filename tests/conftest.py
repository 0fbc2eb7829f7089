"""Shared fixtures, and one compilation cache for all runs of the tests."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import jax
import pytest
from hypothesis import settings

from roadstate.core import numerics
from roadstate.run import chunk

ROOT = Path(__file__).resolve().parent.parent

# Tests compile thousands of programs and run each for a moment: without the optimiser that takes less than
# half the time. Read when the first array is made; an XLA that does not know a flag refuses to start.
QUICKLY = {"--xla_cpu_use_fusion_emitters=false": (0, 11), "--xla_backend_optimization_level=0": (0, 12)}
_known = [flag for flag, until in QUICKLY.items() if jax.__version_info__ < until]
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *_known]).strip()

# nor are loops optimised, unless a test asks for it (``optimised``)
numerics.LOOP_OPTIONS["xla_backend_optimization_level"] = 0
# where in the sources each operation comes from takes a twentieth of the tests' time to write down
jax.config.update("jax_traceback_in_locations_limit", 0)
# the tests wait for compilers more than for anything else; but some put other figures into modules, which no
# trace that is kept would show, whichever command they run
numerics.use_compilation_cache = partial(numerics.use_compilation_cache, traces=False)
numerics.use_compilation_cache()
# examples that compile, or wait for a busy machine, have no deadline
settings.register_profile("roadstate", deadline=None)
settings.load_profile("roadstate")


def pytest_collection_finish() -> None:
    """Look for garbage seldom: Python would do so all the time while JAX traces, and find next to none."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Let go of compiled programs, which otherwise come to gigabytes over a run, once there are many.

    Each also takes three maps or four of memory, of which Linux gives a process 65 530; beyond them it ends.
    Not after every module: hundreds of small ones, such as those that build a plant, serve nearly all, and to
    look through them for what can go takes seconds.
    """
    yield
    if memory() > share_of_memory() or maps() > MOST_MAPS:
        jax.clear_caches()
        gc.collect()
        give_back()


MOST_MAPS = 40_000  # a module adds up to ten thousand

chunk.SHORT = 10**9  # whichever program a log would get: here compilers are waited for, whatever its length


@pytest.fixture(scope="module")
def optimised() -> Iterator[None]:
    """Loops optimised as for users, which takes twice as long to compile, for the rest of a module.

    For tests that go through some ten thousand steps in all, each of which is up to ten times as fast.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(numerics.LOOP_OPTIONS, "xla_backend_optimization_level", 1)
        yield


def give_back() -> None:
    """Hand what was freed to the system: glibc keeps it, and each module after would find too much in use."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def share_of_memory() -> float:
    """What this process may have, GB: with the other workers half of what there is, but at least 3."""
    try:
        pages = os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return 3.0
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    return max(3.0, 0.5 * pages * os.sysconf("SC_PAGE_SIZE") / 1e9 / workers)


def memory() -> float:
    """What this process has in memory, GB; without bound where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return math.inf
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e9


def maps() -> int:
    """How many maps of memory this process has; none where the system does not say."""
    try:
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:
        return 0


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; tests that use it skip where it is missing."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    return folder
