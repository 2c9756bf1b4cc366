"""Hypothesis, or if it is absent a substitute for the part that the tests of the paper use."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

EXAMPLES = 25


class Unmet(Exception):
    """A draw outside the assumptions of a test."""


@dataclass(frozen=True)
class Plain:
    """A strategy: a function of the random generator."""

    draw: Callable[[random.Random], Any]

    def map(self, function: Callable[[Any], Any]) -> Plain:
        return Plain(lambda rng: function(self.draw(rng)))


class PlainStrategies:
    """Strategies; every fifth number is an end of its range."""

    DrawFn = Callable[[Plain], Any]

    @staticmethod
    def integers(low: int, high: int) -> Plain:
        return Plain(lambda rng: rng.choice((low, high)) if rng.random() < 0.2 else rng.randint(low, high))

    @staticmethod
    def floats(low: float, high: float) -> Plain:
        return Plain(lambda rng: rng.choice((low, high)) if rng.random() < 0.2 else rng.uniform(low, high))

    @staticmethod
    def booleans() -> Plain:
        return Plain(lambda rng: rng.random() < 0.5)

    @staticmethod
    def sampled_from(values: Sequence[Any]) -> Plain:
        return Plain(lambda rng: rng.choice(values))

    @staticmethod
    def lists(of: Plain, min_size: int, max_size: int) -> Plain:
        return Plain(lambda rng: [of.draw(rng) for _ in range(rng.randint(min_size, max_size))])

    @staticmethod
    def composite(function: Callable[..., Any]) -> Callable[[], Plain]:
        return lambda: Plain(lambda rng: function(lambda strategy: strategy.draw(rng)))


def plain_given(*places: Plain, **names: Plain) -> Callable[[Callable[..., None]], Callable[[], None]]:
    """Run a test on draws from fixed seeds."""

    def drawn(test: Callable[..., None]) -> Callable[[], None]:
        def law() -> None:
            met = 0
            for seed in range(EXAMPLES):
                rng = random.Random(seed)
                try:
                    test(*(each.draw(rng) for each in places), **{name: each.draw(rng) for name, each in names.items()})
                    met += 1
                except Unmet:
                    continue
            assert met > 0

        law.__name__, law.__doc__ = test.__name__, test.__doc__
        return law

    return drawn


def plain_settings(**_: Any) -> Callable[[Callable[[], None]], Callable[[], None]]:
    """Ignore settings."""
    return lambda law: law


def plain_assume(condition: object) -> None:
    """Skip a draw."""
    if not condition:
        raise Unmet


try:
    from hypothesis import assume, given, settings
    from hypothesis import strategies as st
except ModuleNotFoundError:
    assume, given, settings, st = plain_assume, plain_given, plain_settings, PlainStrategies

__all__ = ["assume", "given", "settings", "st"]
