"""A road whose friction has been measured: an estimator that has no other road in mind."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from roadstate.core import InputError
from roadstate.estimators import Estimator
from roadstate.estimators.friction_bank import FrictionBank

LEAST, MOST = 0.05, 1.5
"""Peak frictions of road that make sense."""
_WHERE = "--road-friction"


def bank_of(estimator: Estimator[Any]) -> FrictionBank | None:
    """The hypotheses of friction that it weighs, if it does."""
    bank = getattr(estimator, "bank", None)
    return bank if isinstance(bank, FrictionBank) else None


def with_friction(estimator: Estimator[Any], friction: float) -> Estimator[Any]:
    """The estimator with this peak friction for every hypothesis of its bank."""
    bank = bank_of(estimator)
    assert bank is not None
    told = jnp.full_like(bank.friction, friction), jnp.full_like(bank.prior, 1 / len(bank.prior))
    changed: Estimator[Any] = eqx.tree_at(lambda e: (e.bank.friction, e.bank.prior), estimator, told)
    return changed


def on_road(estimator: Estimator[Any], friction: float) -> Estimator[Any]:
    """The estimator with the measured peak friction for every hypothesis of its bank.

    All of them alike, no drift or change of the road takes any weight away from the friction that is known,
    and what the file says of friction on dry asphalt counts no more.

    Args:
        estimator: that holds a :class:`~roadstate.estimators.friction_bank.FrictionBank`.
        friction: μ of the road, [–].

    Raises:
        InputError: the friction makes no sense, or the estimator holds no such bank.
    """
    if not LEAST <= friction <= MOST:  # NaN as well
        raise InputError(
            f"{friction:g} is no peak friction of a road",
            where=_WHERE,
            mend=f"give one from {LEAST:g} to {MOST:g}",
        )
    if bank_of(estimator) is None:
        raise InputError(
            f"'{estimator.name}' weighs no hypotheses of friction that could be told",
            where=_WHERE,
            mend="say --estimator joint, or leave the friction out",
        )
    return with_friction(estimator, friction)
