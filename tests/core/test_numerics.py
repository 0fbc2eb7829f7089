"""Packing of pytrees, Gaussians in square-root form, and the compilation cache."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import numerics
from roadstate.core.gaussian import Gaussian
from roadstate.core.packing import Layout

TREE: dict[str, Any] = {
    "matrix": jnp.arange(6.0).reshape(2, 3),
    "scalar": jnp.asarray(-0.0),
    "count": jnp.asarray(7, jnp.int32),
    "key": jnp.asarray([2**32 - 1, 0], jnp.uint32),
    "large": jnp.asarray([2**63 - 1, -(2**63), -1]),
    "flag": jnp.asarray([True, False]),
    "half": (jnp.asarray([1 / 3], jnp.float32), jnp.zeros((0,))),
}


def test_packing_is_exact() -> None:
    layout = Layout(TREE)
    packed = layout.pack(TREE)
    assert {kind: vector.shape for kind, vector in packed.items()} == {
        "float64": (7 + 8,),  # the whole numbers among them
        "float32": (1,),
    }
    back = layout.unpack(packed)
    assert jax.tree.structure(back) == jax.tree.structure(TREE)
    for a, b in zip(jax.tree.leaves(TREE), jax.tree.leaves(back), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
        assert (jnp.signbit(a) == jnp.signbit(b)).all() if a.dtype.kind == "f" else True


def test_leading_axes_stay_in_front() -> None:
    layout = Layout(TREE)
    stacked = jax.vmap(layout.pack)(jax.tree.map(lambda x: jnp.stack([x, x, x]), TREE))
    for rows in (layout.unpack(stacked), layout.unpack({k: np.asarray(v) for k, v in stacked.items()})):
        assert rows["matrix"].shape == (3, 2, 3)
        np.testing.assert_array_equal(rows["matrix"][1], TREE["matrix"])
        np.testing.assert_array_equal(rows["large"][2], TREE["large"])
        np.testing.assert_array_equal(rows["count"], [7, 7, 7])


def test_a_layout_is_known_by_its_shapes_alone() -> None:
    shapes = jax.eval_shape(lambda: TREE)
    assert Layout(shapes) == Layout(TREE)
    assert hash(Layout(shapes)) == hash(Layout(TREE))
    assert Layout(TREE) != Layout({**TREE, "count": jnp.asarray(7, jnp.int16)})
    assert Layout(TREE) != Layout({**TREE, "scalar": jnp.zeros(2)})
    assert Layout(TREE) != "layout"


def test_another_tree_does_not_fit() -> None:
    with pytest.raises(ValueError, match=r"zip\(\) argument 2"):
        Layout(TREE).pack({"a": jnp.zeros(2)})


def test_a_gaussian_knows_its_covariance() -> None:
    gaussian = Gaussian(jnp.zeros(2), jnp.asarray([[3.0, 0], [4.0, 5.0]]))
    np.testing.assert_allclose(gaussian.cov, [[9, 12], [12, 41]])
    np.testing.assert_allclose(gaussian.std, [3, np.sqrt(41)])


def python(code: str, **environment: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip()


def test_programs_are_kept_in_the_cache(tmp_path: Path) -> None:
    code = """
from roadstate.core.numerics import use_compilation_cache
import jax
folder = use_compilation_cache()
print(folder, jax.config.jax_compilation_cache_dir, jax.numpy.zeros(1).dtype)
jax.jit(lambda x: jax.numpy.linalg.qr(x @ x)[1])(jax.numpy.eye(40)).block_until_ready()
"""
    folder = tmp_path / "a" / "b"
    # whoever sets JAX_ENABLE_X64 decides on the precision
    assert python(code, ROADSTATE_CACHE=str(folder), JAX_ENABLE_X64="0") == f"{folder} {folder} float32"
    assert list(folder.iterdir())


def test_a_program_that_was_not_written_to_its_end_is_compiled_and_kept_again(tmp_path: Path) -> None:
    code = """
import jax
from roadstate.core.numerics import use_compilation_cache
use_compilation_cache()
jax.jit(lambda x: x @ x)(jax.numpy.eye(40)).block_until_ready()
"""

    kept = {"ROADSTATE_CACHE": str(tmp_path), "PYTHONWARNINGS": "error::UserWarning"}
    python(code, **kept)
    (program,) = tmp_path.glob("jit__lambda*-cache")
    length = program.stat().st_size
    os.truncate(program, length // 2)
    python(code, **kept)  # without a word on it
    assert abs(program.stat().st_size - length) < 100  # it holds how long the compiler took


def test_what_is_in_the_cache_is_looked_through_once(tmp_path: Path) -> None:
    whole, torn = tmp_path / "jit_a-cache", tmp_path / "jit_b-cache"
    whole.write_bytes(zlib.compress(b"program" * 100))
    torn.write_bytes(zlib.compress(b"program" * 100)[:-5])
    (tmp_path / "jit_c-cache").touch()
    numerics._tidy(tmp_path)
    assert [path.name for path in tmp_path.glob("*-cache")] == ["jit_a-cache"]

    numerics._tidy(tmp_path)  # the removal has made the folder newer than the look
    os.utime(tmp_path / "looked-through", (4e9, 4e9))  # in a distant future
    torn.write_bytes(b"x")
    numerics._tidy(tmp_path)
    assert torn.exists()
    os.utime(tmp_path / "looked-through", (0, 0))
    torn.write_bytes(b"(\xb5/\xfd")  # not of zlib
    os.truncate(whole, 8)
    numerics._tidy(tmp_path)
    assert [path.name for path in tmp_path.glob("*-cache")] == ["jit_b-cache"]


def test_what_nothing_has_read_for_months_goes(tmp_path: Path) -> None:
    now, days = time.time(), 86400.0
    ages = {"a": (100, 100), "b": (10, 100), "c": (100, 10)}  # days since it was read, and written
    mine = [tmp_path / name for name in ("notes.part", "a-cache", "mine.traced")]
    kept = []
    for letter, (read, written) in ages.items():
        for kind in ("-cache", ".traced", ".9.part"):
            path = tmp_path / f"{letter * 64}{kind}"
            path.write_bytes(b"(")
            os.utime(path, (now - read * days, now - written * days))
            kept += [path] if letter != "a" else []
    for path in mine:
        path.write_bytes(b"(")
        os.utime(path, (now - 100 * days, now - 100 * days))
    numerics._tidy(tmp_path)
    assert {*tmp_path.iterdir()} == {*kept, *mine, tmp_path / "looked-through"}


def test_the_cache_can_be_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = jax.config.jax_compilation_cache_dir
    monkeypatch.setenv("ROADSTATE_CACHE", "")
    assert numerics.use_compilation_cache() is None
    (tmp_path / "file").touch()
    assert numerics.use_compilation_cache(tmp_path / "file" / "x") is None
    assert jax.config.jax_compilation_cache_dir == before


def test_the_cache_lies_in_the_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert numerics._default_folder() == "/somewhere/roadstate/jax"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/me")
    assert numerics._default_folder() == "/home/me/.cache/roadstate/jax"


def test_a_compiled_loop_works_inside_other_transformations() -> None:
    @numerics.jit_loop
    def powers(x: jax.Array) -> jax.Array:
        """1, x, x² …"""
        return jax.lax.scan(lambda c, _: (c * x, c), jnp.ones_like(x), None, length=4)[1]

    x = jnp.asarray([2.0, 3.0])
    expected = np.asarray(x) ** np.arange(4)[:, None]
    for call in (powers, jax.jit(powers), lambda a: jax.vmap(powers, out_axes=1)(a)):
        np.testing.assert_allclose(call(x), expected)
    slope = jax.grad(lambda a: powers(a)[3].sum())
    for call in (slope, jax.jit(slope)):
        np.testing.assert_allclose(call(x), 3 * np.asarray(x) ** 2)
    assert powers.__doc__ == "1, x, x² …"


def test_threads_that_come_at_once_share_one_program() -> None:
    traced: list[int] = []
    together = Barrier(4)

    @numerics.jit_loop
    def doubled(x: jax.Array) -> jax.Array:
        traced.append(1)
        return jax.lax.fori_loop(0, 3, lambda _, v: 2 * v, x)

    def call(_: int) -> float:
        together.wait()
        return float(doubled(jnp.asarray(1.5)))

    numerics._is_known.cache_clear()  # as before the first loop of a process: to know the options takes long
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(call, range(4))) == [12.0] * 4
    assert len(traced) == 1


def test_double_precision_is_the_default() -> None:
    assert jnp.zeros(1).dtype == jnp.float64


def test_the_shared_types_do_not_wait_for_jax() -> None:
    assert python("import sys, roadstate, roadstate.core; print('jax' in sys.modules)") == "False"
