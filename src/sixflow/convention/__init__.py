"""The convention: the six numbers of the motion at a point, and everything that follows from them.

x is to the right (column), y down (row); I1(x + u) = I0(x), frame 0 being the reference. The six, in the
order used everywhere, are `SIX`: u, v (px), divergence, curl, stretch, shear (dimensionless).

| module | idea |
|---|---|
| `six` | the six ↔ displacement and gradient ↔ 3×3 matrices ↔ generators |
| `affine` | compose, inverse, exp, log |
| `strain` | finite and infinitesimal measures of deformation, each under its own name |
| `principal` | principal values, axis and maximum shear of a symmetric tensor |
| `derivatives`, `propagation` | covariance through all of them |
| `reference` | about a point of frame 0, of the middle, of frame 1 |
| `orientation` | y up instead of y down |
"""

from sixflow.convention.affine import coefficients_from_six as coefficients_from_six
from sixflow.convention.affine import compose as compose
from sixflow.convention.affine import compose_six as compose_six
from sixflow.convention.affine import exp as exp
from sixflow.convention.affine import exp_six as exp_six
from sixflow.convention.affine import inverse as inverse
from sixflow.convention.affine import inverse_six as inverse_six
from sixflow.convention.affine import log as log
from sixflow.convention.affine import log_six as log_six
from sixflow.convention.affine import six_from_coefficients as six_from_coefficients
from sixflow.convention.derivatives import numerical_jacobian as numerical_jacobian
from sixflow.convention.orientation import Y_UP_SIGNS as Y_UP_SIGNS
from sixflow.convention.orientation import to_y_up as to_y_up
from sixflow.convention.principal import max_shear as max_shear
from sixflow.convention.principal import principal_angle as principal_angle
from sixflow.convention.principal import principal_values as principal_values
from sixflow.convention.propagation import composition_jacobians as composition_jacobians
from sixflow.convention.propagation import jacobian as jacobian
from sixflow.convention.propagation import propagate as propagate
from sixflow.convention.propagation import propagate_composition as propagate_composition
from sixflow.convention.reference import change_reference as change_reference
from sixflow.convention.six import GENERATOR_NAMES as GENERATOR_NAMES
from sixflow.convention.six import GENERATORS as GENERATORS
from sixflow.convention.six import GRADIENT_FROM_SIX as GRADIENT_FROM_SIX
from sixflow.convention.six import SIX as SIX
from sixflow.convention.six import SIX_FROM_GRADIENT as SIX_FROM_GRADIENT
from sixflow.convention.six import affine_from_six as affine_from_six
from sixflow.convention.six import algebra_from_six as algebra_from_six
from sixflow.convention.six import displacement as displacement
from sixflow.convention.six import gradient as gradient
from sixflow.convention.six import recentre as recentre
from sixflow.convention.six import six_from_affine as six_from_affine
from sixflow.convention.six import six_from_algebra as six_from_algebra
from sixflow.convention.six import six_from_gradient as six_from_gradient
from sixflow.convention.six import transform_points as transform_points
from sixflow.convention.strain import almansi as almansi
from sixflow.convention.strain import area_ratio as area_ratio
from sixflow.convention.strain import biot as biot
from sixflow.convention.strain import deformation_gradient as deformation_gradient
from sixflow.convention.strain import green_lagrange as green_lagrange
from sixflow.convention.strain import hencky as hencky
from sixflow.convention.strain import rotation_angle as rotation_angle
from sixflow.convention.strain import small_rotation as small_rotation
from sixflow.convention.strain import small_strain as small_strain
