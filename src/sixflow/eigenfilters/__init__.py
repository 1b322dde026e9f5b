"""Eigenfilters: quadrature operators for all six generators, whose phase shift is the deformation.

After R. Eagleson, *Measurement of Motion-Induced Image Deformations*, §§3–5.

| module | holds |
|---|---|
| `generators` | the six generators (and ∂/∂t): fields, flows, brackets |
| `coordinates` | canonical coordinates of a commuting pair |
| `kernel`, `kernels` | Gabor, spiral and hyperbolic kernels and their derivatives |
| `temporal` | weights over several frames |
| `geometry`, `window` | what kernels are made of |
| `bank`, `default` | a bank of kernels: matrices, noise, whitening, picture |
| `neighbourhood` | log-polar and hyperbolic maps of an image, and their correlation |
| `joint` | all six numbers at once from the responses of a bank |
| `historical` | operators that came before, to compare with |
"""

from sixflow.eigenfilters.bank import FilterBank as FilterBank
from sixflow.eigenfilters.coordinates import CanonicalCoordinates as CanonicalCoordinates
from sixflow.eigenfilters.coordinates import canonical as canonical
from sixflow.eigenfilters.default import default_bank as default_bank
from sixflow.eigenfilters.generators import Generator as Generator
from sixflow.eigenfilters.generators import bracket as bracket
from sixflow.eigenfilters.generators import commute as commute
from sixflow.eigenfilters.joint import JointEstimate as JointEstimate
from sixflow.eigenfilters.joint import JointOperator as JointOperator
from sixflow.eigenfilters.kernels import Gabor as Gabor
from sixflow.eigenfilters.kernels import Hyperbolic as Hyperbolic
from sixflow.eigenfilters.kernels import Spiral as Spiral
from sixflow.eigenfilters.neighbourhood import correlation_surface as correlation_surface
from sixflow.eigenfilters.neighbourhood import hyperbolic_map as hyperbolic_map
from sixflow.eigenfilters.neighbourhood import log_polar_map as log_polar_map
from sixflow.eigenfilters.temporal import temporal_weights as temporal_weights
