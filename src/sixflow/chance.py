"""Chance: the one rate at which right points may be called wrong, and what follows from it.

Every question that a test of the field asks, whether two predictions differ or whether windows look alike, is answered
at this rate. A question that asks n things of one point shares the rate between them (Bonferroni).
"""

from __future__ import annotations

import math
from statistics import NormalDist

FALSE_ALARMS = 1e-4
"""Probability at which chance alone fails a point, for each kind of question."""


def normal_limit(questions: float = 1.0) -> float:
    """Standard deviations that the largest of so many normal deviates exceeds by chance at `FALSE_ALARMS`, two-sided.

    Examples
    --------
    >>> round(normal_limit(), 2), round(normal_limit(8), 2)
    (3.89, 4.37)
    """
    return -NormalDist().inv_cdf(FALSE_ALARMS / questions / 2)


def evidence_limit(places: float = 1.0) -> float:
    """Log-likelihood against chance, nats, that a match needs where so many places were tried.

    Examples
    --------
    >>> round(evidence_limit(), 1), round(evidence_limit(100), 1)
    (9.2, 13.8)
    """
    return math.log(places / FALSE_ALARMS)


def count_limit(mean: float) -> int:
    """Number that a Poisson count of some mean exceeds by chance at `FALSE_ALARMS`.

    Examples
    --------
    >>> count_limit(0.0), count_limit(1.0)
    (0, 6)
    """
    from scipy.special import gammainc

    count = int(mean)
    while mean and gammainc(count + 1, mean) > FALSE_ALARMS:
        count += 1
    return count


def run_limit(share: float, places: float) -> float:
    """Length of a run of equal neighbours that chance does not reach at `FALSE_ALARMS`, at any of so many places.

    Parameters
    ----------
    share : float
        Of neighbours that are equal by chance, less than 1.
    places : float

    Examples
    --------
    >>> round(run_limit(0.1, 1000))
    8
    """
    return 1 - evidence_limit(places) / math.log(share)
