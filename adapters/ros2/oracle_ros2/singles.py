"""32-bit floats, each as the shortest decimal that means it: 0.1, not 0.10000000149011612."""

from __future__ import annotations

from typing import Sequence

import numpy

FEW = 64
"""Numbers up to which one by one is no slower."""
_TENS = numpy.array([float(10**n) for n in range(23)])  # all that are exact
_TIE = 1e-6  # of a digit: what a product may be off by, and more


def shortest(value: float) -> float:
    """One of them."""
    return float(str(numpy.float32(value)))


def all_shortest(values: Sequence[float]) -> list[float]:
    """A list of them, long ones at a sixth of the cost."""
    if len(values) <= FEW:
        return [shortest(value) for value in values]
    single = numpy.asarray(values, numpy.float32)
    with numpy.errstate(invalid="ignore"):  # NaN that signals
        found = single.astype(float)  # zeros, infinities and NaN are as they are
    size = numpy.abs(found)
    usual = (size >= 1e-13) & (size < 1e6)  # so that the scales are exact
    slow = ~usual & numpy.isfinite(found) & (size > 0)
    left = numpy.flatnonzero(usual)
    places = numpy.floor(numpy.log10(size[left])).astype(int)
    for digits in (6, 7, 8, 9):  # up to six there is one decimal at most that means a number
        scale = _TENS[digits - 1 - places]
        scaled = found[left] * scale
        whole = numpy.rint(scaled)
        short = whole / scale
        means = short.astype(numpy.float32) == single[left]
        tie = numpy.abs(numpy.abs(scaled - whole) - 0.5) < _TIE  # of two decimals that may mean it
        slow[left[tie]] = True
        found[left[means]] = short[means]
        left, places = left[~means], places[~means]
    for place in numpy.flatnonzero(slow):
        found[place] = shortest(single[place])
    return list(found.tolist())
