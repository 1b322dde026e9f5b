"""Interpretation: from a measured field to time to contact, slant and motion, with standard errors.

```
field ── fit_region ──┬─ time_to_contact, axis_rotation, slant_and_tilt      from the six at a point
 (region: eight with  ├─ fanning, focus_of_expansion                         from the eight
  their covariance)   └─ plane_and_motion, ego_motion
```

Each result states its `assumptions`, and gives every number with its standard error: infinite
where the measurement does not determine it. Axes are those of `sixflow.scenes`: X right, Y down, Z forward.

| module | idea |
|---|---|
| `points`, `correlation`, `model`, `region` | least squares over a region of points whose errors are correlated |
| `sight`, `across` | the six as seen along the line of sight, and what is known of the motion |
| `contact`, `rotation`, `slant`, `fanning`, `expansion`, `structure`, `ego` | one interpretation each |
| `least_squares` | models of the eight |
| `estimate` | numbers with errors, and assumptions |
| `interpret` | all of it |
| `table` | all of it, of all pairs |
"""

from sixflow.interpretation.contact import TimeToContact as TimeToContact
from sixflow.interpretation.contact import time_to_contact as time_to_contact
from sixflow.interpretation.ego import EgoMotion as EgoMotion
from sixflow.interpretation.ego import ego_motion as ego_motion
from sixflow.interpretation.estimate import Estimate as Estimate
from sixflow.interpretation.estimate import Interpretation as Interpretation
from sixflow.interpretation.expansion import FocusOfExpansion as FocusOfExpansion
from sixflow.interpretation.expansion import focus_of_expansion as focus_of_expansion
from sixflow.interpretation.fanning import Fanning as Fanning
from sixflow.interpretation.fanning import fanning as fanning
from sixflow.interpretation.interpret import interpret as interpret
from sixflow.interpretation.region import RegionFit as RegionFit
from sixflow.interpretation.region import fit_region as fit_region
from sixflow.interpretation.rotation import AxisRotation as AxisRotation
from sixflow.interpretation.rotation import axis_rotation as axis_rotation
from sixflow.interpretation.slant import SurfaceSlant as SurfaceSlant
from sixflow.interpretation.slant import slant_and_tilt as slant_and_tilt
from sixflow.interpretation.structure import PlaneAndMotion as PlaneAndMotion
from sixflow.interpretation.structure import plane_and_motion as plane_and_motion
from sixflow.interpretation.table import interpret_all as interpret_all
