"""Lie groups of the plane: translations, rigid motions, similarities, affine and projective maps.

Five groups, each within the next, with one vocabulary: generators, bracket, structure constants, exp, log, compose,
inverse, adjoint, action on points, operators on images (Eagleson, §§2 and 3; as corrected here: the six operators of
eq. (3) span the algebra of the affine group, and are no group themselves).

| group | generators |
|---|---|
| `TRANSLATION` | L_x, L_y |
| `EUCLIDEAN` | L_x, L_y, L_r |
| `SIMILARITY` | L_x, L_y, L_s, L_r |
| `AFFINE` | L_x, L_y, L_s, L_r, L_b, L_B: the six |
| `PROJECTIVE` | the six, L_E, L_F: the planar flow of eq. (2) |

| module | idea |
|---|---|
| `generators` | the eight generators, and how a matrix is written in them |
| `algebra` | coefficients, bracket, velocity field, operators on images |
| `group` | the vocabulary of maps |
| `affine`, `projective` | the five groups |
| `planar_flow` | Kanatani's eight coefficients ↔ those of the projective group |
| `trajectories`, `picture` | one-parameter groups |

>>> import numpy as np
>>> from sixflow import groups
>>> turn = groups.EUCLIDEAN.exp([0, 0, np.pi / 3])
>>> groups.EUCLIDEAN.log(turn).round(6)
array([0.      , 0.      , 1.047198])
"""

from __future__ import annotations

import types
from collections.abc import Mapping

from sixflow.errors import InputError
from sixflow.groups.affine import AFFINE as AFFINE
from sixflow.groups.affine import EUCLIDEAN as EUCLIDEAN
from sixflow.groups.affine import SIMILARITY as SIMILARITY
from sixflow.groups.affine import TRANSLATION as TRANSLATION
from sixflow.groups.generators import NAMES as NAMES
from sixflow.groups.generators import NUMBER_PER_COEFFICIENT as NUMBER_PER_COEFFICIENT
from sixflow.groups.generators import SYMBOLS as SYMBOLS
from sixflow.groups.group import Group as Group
from sixflow.groups.planar_flow import COEFFICIENTS_FROM_EIGHT as COEFFICIENTS_FROM_EIGHT
from sixflow.groups.planar_flow import EIGHT as EIGHT
from sixflow.groups.planar_flow import EIGHT_FROM_COEFFICIENTS as EIGHT_FROM_COEFFICIENTS
from sixflow.groups.planar_flow import coefficients_from_eight as coefficients_from_eight
from sixflow.groups.planar_flow import eight_from_coefficients as eight_from_coefficients
from sixflow.groups.projective import PROJECTIVE as PROJECTIVE
from sixflow.groups.trajectories import draw_trajectories as draw_trajectories
from sixflow.groups.trajectories import trajectory as trajectory

GROUPS: Mapping[str, Group] = types.MappingProxyType(
    {group.name: group for group in (TRANSLATION, EUCLIDEAN, SIMILARITY, AFFINE, PROJECTIVE)}
)
"""The five groups by their names, each within the next."""


def get(group: Group | str) -> Group:
    """Return the group that is meant by a name, or the group itself.

    Parameters
    ----------
    group : str or Group
        "translation", "euclidean", "similarity", "affine" or "projective".

    Raises
    ------
    InputError
        If it is none of them.

    Examples
    --------
    >>> get("similarity").symbols
    ('L_x', 'L_y', 'L_s', 'L_r')
    """
    if isinstance(group, Group):
        return group
    if not isinstance(group, str) or group not in GROUPS:
        raise InputError(f"group={group!r}: must be one of {', '.join(GROUPS)}")
    return GROUPS[group]
