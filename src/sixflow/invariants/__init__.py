"""Invariants of the motion at a point: what stays when the axes of the image are turned, with standard errors.

The *numbers* of a motion are the six (u, v, divergence, curl, stretch, shear) or, for the flow of a plane, the six and
Kanatani's (E, F), in the order of `NAMES`. They are the real and imaginary parts of irreducible quantities, each of
which turns by itself when the axes turn (Kanatani, in Eagleson §2):

| symbol | numbers | weight n | meaning |
|---|---|---|---|
| U₀ = u₀ + iv₀ | u, v | 1 | translation |
| T = A + D | divergence | 0 | divergence |
| R = C − B | curl | 0 | rotation |
| S = (A − D) + i(B + C) | stretch, shear | 2 | shearing |
| K = E + iF | E, F | 1 | fanning |

| module | idea |
|---|---|
| `kanatani` | the numbers as U₀, T, R, S, K; how they turn with the axes |
| `polar` | size and direction of one of them, with errors |
| `deformation` | Koenderink and van Doorn's div, curl and def |

>>> from sixflow import invariants
>>> found = invariants.deformation([0, 0, 0.02, 0.0, 0.0, 0.06])
>>> print(f"{found.magnitude:.2f} along {found.axis:.4f} rad")
0.06 along 0.7854 rad
"""

from sixflow.invariants.deformation import Deformation as Deformation
from sixflow.invariants.deformation import GradientParts as GradientParts
from sixflow.invariants.deformation import deformation as deformation
from sixflow.invariants.deformation import deformation_jacobian as deformation_jacobian
from sixflow.invariants.deformation import gradient_parts as gradient_parts
from sixflow.invariants.kanatani import NAMES as NAMES
from sixflow.invariants.kanatani import WEIGHTS as WEIGHTS
from sixflow.invariants.kanatani import Invariants as Invariants
from sixflow.invariants.kanatani import kanatani as kanatani
from sixflow.invariants.kanatani import numbers_from_eight as numbers_from_eight
from sixflow.invariants.kanatani import turn_axes as turn_axes
from sixflow.invariants.kanatani import turning_matrix as turning_matrix
from sixflow.invariants.polar import Polar as Polar
from sixflow.invariants.polar import size_and_direction as size_and_direction
