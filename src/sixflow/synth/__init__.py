"""Exact truth: frames rendered from analytic patterns in analytic motion, with nothing interpolated.

```
pattern ─┐
motion ──┼─ render → sensor → pair, sequence → frames + truth(x, y)
shape ───┘
```
"""

from sixflow.synth.motions.affine import Affine as Affine
from sixflow.synth.motions.base import Motion as Motion
from sixflow.synth.motions.base import ScaledMotion as ScaledMotion
from sixflow.synth.motions.flows import BoundaryLayer as BoundaryLayer
from sixflow.synth.motions.flows import CellularVortices as CellularVortices
from sixflow.synth.motions.flows import LambOseen as LambOseen
from sixflow.synth.motions.relative import RelativeMotion as RelativeMotion
from sixflow.synth.motions.relative import relative as relative
from sixflow.synth.motions.solids import PlateWithHole as PlateWithHole
from sixflow.synth.motions.solids import Star as Star
from sixflow.synth.motions.views import Homography as Homography
from sixflow.synth.motions.views import PlaneInView as PlaneInView
from sixflow.synth.motions.views import SurfaceInView as SurfaceInView
from sixflow.synth.patterns.base import Pattern as Pattern
from sixflow.synth.patterns.particles import Particles as Particles
from sixflow.synth.patterns.speckle import Speckle as Speckle
from sixflow.synth.patterns.waves import Grating as Grating
from sixflow.synth.patterns.waves import Plaid as Plaid
from sixflow.synth.patterns.waves import Texture as Texture
from sixflow.synth.render import render as render
from sixflow.synth.sensor import Sensor as Sensor
from sixflow.synth.sequence import FrameSequence as FrameSequence
from sixflow.synth.sequence import Pair as Pair
from sixflow.synth.sequence import pair as pair
from sixflow.synth.sequence import sequence as sequence
