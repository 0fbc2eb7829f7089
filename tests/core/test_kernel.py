"""A loop over small arrays as one kernel."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core.kernel import one_kernel
from roadstate.core.numerics import jit_loop


class TestJitLoop:
    """A loop over small arrays becomes one kernel, unless it calls what a kernel cannot."""

    @staticmethod
    def looped(step: Any) -> Any:
        return jit_loop(lambda A, count: jax.lax.fori_loop(0, 5, lambda _, x: step(x) / count, A))

    def text(self, step: Any) -> str:
        def loop(A: Any) -> Any:
            return jax.lax.fori_loop(0, 5, lambda _, x: step(x), A)

        text: str = jax.jit(one_kernel(loop)).lower(jnp.eye(3)).as_text()
        return text

    @pytest.mark.skipif(jax.default_backend() != "cpu", reason="kernels are joined on a CPU only")
    def test_is_one_kernel(self) -> None:
        assert self.text(lambda x: jnp.tanh(x @ x)).count("xla_cpu_small_call") == 1

    @pytest.mark.parametrize(
        "step",
        [
            jnp.linalg.cholesky,
            lambda x: jax.lax.cond(x[0, 0] > 0, lambda: jnp.sort(x), lambda: x),
            lambda x: jax.vmap(jnp.linalg.inv)(x[None])[0],
            lambda x: jax.pure_callback(np.tanh, x, x),
        ],
    )
    def test_is_not_where_it_calls_a_library(self, step: Any) -> None:
        assert "xla_cpu_small_call" not in self.text(step)
        assert self.looped(step)(jnp.eye(3), 2).shape == (3, 3)

    def test_result_is_that_of_the_function(self) -> None:
        A, step = jnp.asarray(np.random.default_rng(0).normal(size=(4, 4))), lambda x: jnp.tanh(x @ x.T)
        by_hand = A
        for _ in range(5):
            by_hand = step(by_hand) / 2
        np.testing.assert_allclose(self.looped(step)(A, 2), by_hand, rtol=1e-13)

    def test_what_is_no_array_passes_through(self) -> None:
        found = jit_loop(lambda tree, name: {"name": name, "twice": 2 * tree["x"]})({"x": jnp.ones(2)}, "a")
        assert found["name"] == "a"
        np.testing.assert_array_equal(found["twice"], [2.0, 2.0])

    @pytest.mark.parametrize("unread", [jnp.ones(3), jnp.ones((2, 0)), jnp.asarray(True), np.int32(3)])
    def test_an_argument_may_be_of_no_use(self, unread: Any) -> None:
        found = jit_loop(lambda tree: jax.lax.fori_loop(0, 5, lambda _, x: 2 * x, tree[0]))(
            (jnp.ones(2), unread)
        )
        np.testing.assert_array_equal(found, [32.0, 32.0])

    def test_the_compiler_may_find_that_an_argument_is_of_no_use(self) -> None:
        def loop(a: Any, b: Any) -> Any:
            return jax.lax.fori_loop(0, 5, lambda _, x: jnp.where(b - b == 0, 2 * x, b), a)

        np.testing.assert_array_equal(jit_loop(loop)(jnp.ones(2, int), jnp.arange(2)), [32, 32])
