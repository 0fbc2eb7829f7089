"""A program as two kernels."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import halves
from roadstate.core.halves import two_kernels

MARK = "xla_cpu_small_call"
pytestmark = pytest.mark.skipif(jax.default_backend() != "cpu", reason="kernels are joined on a CPU only")


@pytest.fixture(autouse=True)
def small_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(halves, "_WORTH", 20)


def mixed(tree: dict[str, Any], times: int) -> dict[str, Any]:
    """Of every kind something crosses the middle, and something goes straight through."""
    x, n, low = tree["x"], tree["n"], tree["low"]
    negative, odd = x < 0, n % 2 == 1
    for k in range(times):
        x = jnp.where(negative, jnp.cos(x), x + 0.1 * k) * jnp.asarray([1.0, 2.0, 3.0])
        low = jnp.tanh(low + x.astype(jnp.float32))
    return {"x": x, "n": jnp.where(odd, n + 1, n), "low": low, "same": tree["n"], "one": 1.0, "flag": odd}


def given() -> dict[str, Any]:
    return {"x": jnp.asarray([-1.0, 0.5, 2.0]), "n": jnp.asarray([3, 2**40]), "low": jnp.ones(3, jnp.float32)}


def lowered(function: Any, *args: Any) -> str:
    text: str = jax.jit(two_kernels(function)).lower(*args).as_text()
    return text


def test_numbers_are_those_of_the_function() -> None:
    found, expected = jax.jit(two_kernels(lambda tree: mixed(tree, 10)))(given()), mixed(given(), 10)
    assert jax.tree.map(jnp.result_type, found) == jax.tree.map(jnp.result_type, expected)
    for name, values in expected.items():
        exact = not jnp.issubdtype(jnp.result_type(values), jnp.floating)
        rtol = 0 if exact else 1e-6 if name == "low" else 1e-13
        np.testing.assert_allclose(found[name], values, rtol=rtol, err_msg=name)


def test_a_large_program_is_two_and_a_small_one_is_one() -> None:
    assert lowered(lambda tree: mixed(tree, 10), given()).count(MARK) == 2
    assert lowered(lambda x: 2 * x, jnp.ones(3)).count(MARK) == 1


def test_derivatives_are_those_of_the_function() -> None:
    def end(function: Any) -> Any:
        return jax.grad(lambda x: jnp.sum(function({**given(), "x": x}, 10)["x"]))(given()["x"])

    np.testing.assert_allclose(end(two_kernels(mixed)), end(mixed), rtol=1e-12)


def test_it_is_cut_where_least_is_handed_over() -> None:
    """In the middle there are a hundred numbers, of which a little later one is left."""

    def narrow(x: Any) -> Any:
        for _ in range(8):
            x = jnp.sin(x)
        wide = x * jnp.arange(100.0)
        for _ in range(8):
            wide = jnp.cos(wide)
        total = jnp.sum(wide)
        for _ in range(16):
            total = jnp.sin(total)
        return total

    program = jax.make_jaxpr(narrow)(1.0).jaxpr
    cut = halves._cut(program)
    assert cut is not None
    assert sum(v.aval.size for v in halves._variables(program.eqns[cut].invars)) == 1
    np.testing.assert_allclose(jax.jit(two_kernels(narrow))(1.0), narrow(1.0), rtol=1e-12)


def test_keys_of_random_numbers_are_not_handed_over() -> None:
    """They stay in one kernel all through the middle, so the program does."""

    def drawn(x: Any) -> Any:
        key = jax.random.key(3)
        for k in range(10):
            x = jnp.sin(x) + jax.random.normal(jax.random.fold_in(key, k))
        return x

    assert lowered(drawn, jnp.ones(3)).count(MARK) == 1
    np.testing.assert_allclose(jax.jit(two_kernels(drawn))(jnp.ones(3)), drawn(jnp.ones(3)), rtol=1e-12)


def test_the_program_is_the_same_each_time() -> None:
    """Else it would be compiled anew in each process."""
    texts = {lowered(lambda tree: mixed(tree, 10), given()) for _ in range(3)}
    assert len(texts) == 1


def test_what_calls_a_library_is_no_kernel() -> None:
    def inverse(x: Any) -> Any:
        for _ in range(12):
            x = jnp.tanh(x) + jnp.eye(3)
        return jnp.linalg.inv(x)

    assert lowered(inverse, jnp.eye(3)).count(MARK) == 1  # the half that does not
    np.testing.assert_allclose(
        jax.jit(two_kernels(inverse))(jnp.eye(3)), inverse(jnp.eye(3)), rtol=1e-12, atol=1e-15
    )
