"""Scenes: from the world to the image and back, for a pinhole camera, surfaces and rigid motion.

Axes of the camera: X right, Y down, Z forward; image x right, y down, in px. One unit of length for all lengths of
a scene, the frame interval for time, radians for angles.

```
Camera ─┐
Plane ──┼─ planar_flow → Eight → six_at(x, y)          velocities, eq. (1) and (2)
Motion ─┘  plane_homography → homography_six           finite displacements
           calibrate → sensitivity                     what the six say of the nine parameters
Eight ──── planar_structure                            back: both solutions, with standard errors
```

| module | idea |
|---|---|
| `camera`, `plane`, `surface`, `motion`, `displacement`, `rotation` | what a scene is made of |
| `flow` | velocities of image points: Eagleson's eq. (1) for any surface, eq. (2) for a plane |
| `kanatani` | eq. (2) as printed, in Kanatani's convention, and the conversion |
| `eight` | the eight coefficients of a plane's flow, and the six at any image point |
| `homography` | the exact displacement of a plane's image |
| `calibration`, `sensitivity` | the six as functions of structure and motion, and the other way round |
| `planar`, `planar_solution` | structure and motion from the eight coefficients |
| `picture` | the calibration drawn |
"""

from sixflow.scenes.calibration import NINE as NINE
from sixflow.scenes.calibration import Calibration as Calibration
from sixflow.scenes.calibration import calibrate as calibrate
from sixflow.scenes.calibration import eight_from_nine as eight_from_nine
from sixflow.scenes.calibration import eight_jacobian as eight_jacobian
from sixflow.scenes.camera import Camera as Camera
from sixflow.scenes.displacement import RigidDisplacement as RigidDisplacement
from sixflow.scenes.eight import EIGHT as EIGHT
from sixflow.scenes.eight import Eight as Eight
from sixflow.scenes.eight import recentring_matrix as recentring_matrix
from sixflow.scenes.eight import six_matrix as six_matrix
from sixflow.scenes.flow import image_velocity as image_velocity
from sixflow.scenes.flow import planar_flow as planar_flow
from sixflow.scenes.flow import surface_displacement as surface_displacement
from sixflow.scenes.flow import surface_flow as surface_flow
from sixflow.scenes.homography import apply_homography as apply_homography
from sixflow.scenes.homography import homography_flow as homography_flow
from sixflow.scenes.homography import homography_six as homography_six
from sixflow.scenes.homography import plane_homography as plane_homography
from sixflow.scenes.kanatani import KanataniScene as KanataniScene
from sixflow.scenes.kanatani import from_kanatani as from_kanatani
from sixflow.scenes.kanatani import kanatani_coefficients as kanatani_coefficients
from sixflow.scenes.kanatani import to_kanatani as to_kanatani
from sixflow.scenes.motion import RigidMotion as RigidMotion
from sixflow.scenes.planar import planar_structure as planar_structure
from sixflow.scenes.planar_solution import PlanarErrors as PlanarErrors
from sixflow.scenes.planar_solution import PlanarSolution as PlanarSolution
from sixflow.scenes.plane import Plane as Plane
from sixflow.scenes.sensitivity import Sensitivity as Sensitivity
from sixflow.scenes.sensitivity import sensitivity as sensitivity
from sixflow.scenes.surface import DepthMap as DepthMap
from sixflow.scenes.surface import Surface as Surface
