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
| `patches`, `responses` | responses of a bank at points, at every pixel, over a pyramid |
| `neighbourhood`, `correlation` | log-polar and hyperbolic maps of an image, and their correlation |
| `literal`, `reading`, `combination` | each operator alone: phase over order, and the mean over a family |
| `joint` | all six numbers at once from the responses of a bank |
| `pooled` | the same from an array of banks under a window, at points |
| `projection`, `array`, `pool`, `passes` | such arrays over whole frames: `measure(..., method="eigenfilter")` |
| `historical` | operators that came before, to compare with |
"""

from sixflow.eigenfilters.bank import FilterBank as FilterBank
from sixflow.eigenfilters.combination import Combination as Combination
from sixflow.eigenfilters.coordinates import CanonicalCoordinates as CanonicalCoordinates
from sixflow.eigenfilters.coordinates import canonical as canonical
from sixflow.eigenfilters.correlation import Correlation as Correlation
from sixflow.eigenfilters.correlation import correlation_surface as correlation_surface
from sixflow.eigenfilters.default import default_bank as default_bank
from sixflow.eigenfilters.generators import Generator as Generator
from sixflow.eigenfilters.generators import bracket as bracket
from sixflow.eigenfilters.generators import commute as commute
from sixflow.eigenfilters.joint import JointEstimate as JointEstimate
from sixflow.eigenfilters.joint import JointOperator as JointOperator
from sixflow.eigenfilters.kernels import Gabor as Gabor
from sixflow.eigenfilters.kernels import Hyperbolic as Hyperbolic
from sixflow.eigenfilters.kernels import Spiral as Spiral
from sixflow.eigenfilters.literal import LiteralOperator as LiteralOperator
from sixflow.eigenfilters.neighbourhood import hyperbolic_map as hyperbolic_map
from sixflow.eigenfilters.neighbourhood import log_polar_map as log_polar_map
from sixflow.eigenfilters.pooled import PooledOperator as PooledOperator
from sixflow.eigenfilters.reading import LiteralEstimate as LiteralEstimate
from sixflow.eigenfilters.responses import ResponseLevel as ResponseLevel
from sixflow.eigenfilters.responses import respond as respond
from sixflow.eigenfilters.responses import respond_dense as respond_dense
from sixflow.eigenfilters.responses import response_pyramid as response_pyramid
from sixflow.eigenfilters.temporal import temporal_weights as temporal_weights
