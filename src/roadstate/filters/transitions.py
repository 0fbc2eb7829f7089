"""Predictions across the last N steps, carried along at a cost that does not depend on N."""

from __future__ import annotations

from typing import NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gaussian
from roadstate.core.kernel import once
from roadstate.linalg import product, tria

T = TypeVar("T")


class Transition(NamedTuple):
    """An affine step x⁺ = F x + b + w, w ~ N(0, G Gᵀ).

    Attributes:
        F: (n, n).
        offset: (n,) b.
        noise: (n, n) G.
    """

    F: Float[Array, "n n"]
    offset: Float[Array, " n"]
    noise: Float[Array, "n n"]

    @staticmethod
    def identity(like: Gaussian) -> Transition:
        """No step at all."""
        zero = jnp.zeros_like(like.factor)
        return Transition(jnp.eye(zero.shape[0], dtype=zero.dtype), jnp.zeros_like(like.mean), zero)

    def then(self, later: Transition) -> Transition:
        """This step and ``later`` as one."""
        return Transition(
            product(later.F, self.F),
            product(later.F, self.offset[:, None])[:, 0] + later.offset,
            tria(jnp.concatenate([product(later.F, self.noise), later.noise], axis=1)),
        )

    def predict(self, gaussian: Gaussian) -> Gaussian:
        """Where the step takes a Gaussian."""
        return Gaussian(
            product(self.F, gaussian.mean[:, None])[:, 0] + self.offset,
            tria(jnp.concatenate([product(self.F, gaussian.factor), self.noise], axis=1)),
        )


class SlidingState(NamedTuple):
    """State of :class:`SlidingPrediction`: two blocks of B = N // 2 steps each, written in turns.

    Attributes:
        position: step within 2B.
        taken: how many steps, up to N + 1.
        last: the posterior of the step before.
        steps: (2B, …) the steps of the current block so far, and those of the block before.
        ahead: (2B, …) posteriors; those of the block before are being replaced, from the end of the block
            backwards, by their prediction to the end of their block.
        prefix: all steps of the current block so far, as one.
        block: all steps of the block before, as one.
        suffix: the steps of the block before that were already gone back over, as one.
    """

    position: Int[Array, ""]
    taken: Int[Array, ""]
    last: Gaussian
    steps: Transition
    ahead: Gaussian
    prefix: Transition
    block: Transition
    suffix: Transition


class SlidingPrediction(eqx.Module):
    """The pure prediction x̂_{k|k−N}, P_{k|k−N} from the posterior N steps ago.

    Predicting anew would cost N predictions a step. Affine steps compose, and composition is associative,
    so the window is kept as three parts: the rest of the block before last, the block before as a whole and
    the current block up to now. While a block fills, one goes back over the block before it step by step,
    predicting each of its posteriors to its end, so that these are ready when the window's tail reaches
    them. Each step costs two compositions and three predictions whatever N is, and no branch depends on data.

    Attributes:
        length: N ≥ 2.

    Raises:
        ValueError: N < 2.
    """

    length: int = eqx.field(static=True)

    def __check_init__(self) -> None:
        """Refuse a window without two blocks."""
        if self.length < 2:
            raise ValueError(f"a memory of at least 2 steps is needed, got {self.length}")

    def init(self, start: Gaussian) -> SlidingState:
        """Before the first step."""
        one = Transition.identity(start)
        size = 2 * (self.length // 2)

        def repeated(tree: T) -> T:
            return cast(T, jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (size, *leaf.shape)), tree))

        zero = jnp.zeros((), jnp.int32)
        return SlidingState(zero, zero, start, repeated(one), repeated(start), one, one, one)

    def push(
        self, state: SlidingState, step: Transition, posterior: Gaussian, taken: Bool[Array, ""]
    ) -> tuple[SlidingState, Gaussian]:
        """Take one step and the posterior at its end; unless ``taken``, leave the state as it is.

        Returns:
            The new state and the prediction from N steps ago; before there were N steps, nothing useful
            (see :meth:`full`).
        """
        half = self.length // 2
        here = state.position
        place = here % half
        starts = place == 0
        one = Transition.identity(posterior)
        block = select(starts, state.prefix, state.block)
        prefix = select(starts, one, state.prefix).then(step)
        suffix = select(starts, one, state.suffix)
        back = (here - place + half) % (2 * half) + half - 1 - place
        # all that is read, before anything is written: else the stacks would be copied whole
        read = _take(state.steps, here), _take(state.steps, back), _take(state.ahead, here)
        (replaced, later, tail), earlier, here, back = once((read, _take(state.ahead, back), here, back))
        odd = self.length % 2 == 1
        longer = later.then(suffix)
        newest = state.last if odd else posterior
        ended = (longer if odd else suffix).predict(earlier)
        steps = _put(state.steps, here, select(taken, step, replaced))
        # what stood here, the posterior of two blocks ago, is by now predicted to the end of its block
        ahead = _put(state.ahead, here, select(taken, newest, tail))
        ahead = _put(ahead, back, select(taken, ended, earlier))

        after = (posterior, prefix, block, longer)
        last, prefix, block, suffix = select(
            taken, after, (state.last, state.prefix, state.block, state.suffix)
        )
        count = jnp.where(taken, jnp.minimum(state.taken + 1, self.length + 1), state.taken)
        position = jnp.where(taken, (here + 1) % (2 * half), here)
        predicted = after[1].predict(after[2].predict(tail))
        return SlidingState(position, count, last, steps, ahead, prefix, block, suffix), predicted

    def full(self, state: SlidingState) -> Array:
        """Whether more than N steps were taken, so that the prediction is from a posterior."""
        return state.taken > self.length


def select(condition: Bool[Array, ""], yes: T, no: T) -> T:
    """One of two trees."""
    return cast(T, jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no))


def _take(stack: T, index: Int[Array, ""]) -> T:
    return cast(T, jax.tree.map(lambda leaf: leaf[index], stack))


def _put(stack: T, index: Int[Array, ""], value: T) -> T:
    return cast(T, jax.tree.map(lambda leaf, new: leaf.at[index].set(new), stack, value))
