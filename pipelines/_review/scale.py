"""Time, price and bytes of many co-paintings on several machines, from measured rates: Amdahl's law, and no more."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipelines._review.rates import Rates, Sizes

_SHARE = (0.05, 0.95)  # of the shards: between these an interval lies


class Interval(NamedTuple):
    """A mean, and what it would be if all shards were like the fast ones or like the slow ones."""

    mean: float
    low: float
    high: float


class Factors(NamedTuple):
    """What other sizes multiply; time is their product, bytes are picture pixels alone."""

    strokes: float
    pixels: float
    iterations: float
    picture_pixels: float

    @property
    def time(self) -> float:
        return self.strokes * self.pixels * self.iterations


def factors(wanted: Sizes, measured: Sizes) -> Factors:
    """By how much sizes exceed those that were measured."""
    return Factors(
        wanted.strokes / measured.strokes,
        wanted.pixels / measured.pixels,
        wanted.iterations / measured.iterations,
        wanted.picture_pixels / measured.picture_pixels,
    )


@dataclass(frozen=True)
class Plan:
    """So many paintings of one setting on so many machines of `cores` cores each."""

    rates: Rates
    paintings: int
    machines: int
    cores: int
    price: float | None
    """Of a machine for an hour, in any currency."""
    sizes: Sizes
    """At which they are painted."""
    profile: str | None
    """Where these sizes stand; None where they are those that were measured."""

    @property
    def factors(self) -> Factors:
        return factors(self.sizes, self.rates.sizes)

    def painting_s(self) -> Interval:
        """Seconds of one core for a painting, at the measured sizes."""
        shards = np.array(self.rates.shards_s)
        return Interval(*(self.rates.painting_s(float(s)) for s in (shards.mean(), *np.quantile(shards, _SHARE))))

    def core_s(self) -> Interval:
        """Seconds of cores for all paintings, which any number of workers may share."""
        return Interval(*(seconds * self.factors.time * self.paintings for seconds in self.painting_s()))

    def sharded_s(self, machines: int) -> Interval:
        """Wall time of painting. One machine paints with plain processes; more are a cluster, with its overhead."""
        more = 1 + self.rates.overhead.share if machines > 1 else 1.0
        return Interval(*(seconds * more / (machines * self.cores) for seconds in self.core_s()))

    def keeping_s(self) -> float:
        """Wall time after the last shard: of all pairs, one after the other, and so of their pixels."""
        return self.rates.end_s * self.paintings / self.rates.paintings * self.factors.picture_pixels

    def serial_s(self) -> float:
        """Wall time of all that one machine does alone, whatever the number of machines."""
        return self.rates.begin_s + self.keeping_s() + sum(timing.seconds for timing in self.rates.serial)

    def wall_s(self, machines: int) -> Interval:
        """Wall time of everything, one after the other."""
        return Interval(*(seconds + self.serial_s() for seconds in self.sharded_s(machines)))

    def speed_up(self, machines: int) -> float:
        """Over one machine."""
        return self.wall_s(1).mean / self.wall_s(machines).mean

    def cost(self, machines: int) -> Interval:
        """Price of all machines while they paint, and of one for the rest; needs `price`."""
        assert self.price is not None
        hourly = self.price / 3600
        return Interval(*(hourly * (machines * s + self.serial_s()) for s in self.sharded_s(machines)))

    def pairs(self) -> float:
        """How many pairs of a partial and a full painting there will be."""
        return self.rates.pairs / self.rates.paintings * self.paintings

    def kept_bytes(self) -> float:
        """Of the pairs' shards on disk."""
        return self.rates.bytes / self.rates.pairs * self.pairs() * self.factors.picture_pixels

    def memory_bytes(self) -> float:
        """Of the pairs' pictures, three bytes a pixel, which finetune_goal_planner holds in memory before it trains."""
        return 2 * 3 * self.sizes.picture_pixels * self.pairs()
