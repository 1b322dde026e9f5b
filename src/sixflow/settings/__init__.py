"""Settings: how a field is measured, checked when it is said.

| module | what |
|---|---|
| `settings` | `Settings`: one frozen dataclass = keyword arguments = command line = TOML file = attributes |
| `types`, `ranges` | what each setting may be |
| `affine_guess` | a first guess of the motion, in numbers |
| `region` | the region of interest, a rectangle and polygons |
"""

from sixflow.settings.ranges import WIDEST as WIDEST
from sixflow.settings.settings import Settings as Settings
from sixflow.settings.settings import require_names as require_names
from sixflow.settings.settings import require_settings as require_settings
from sixflow.settings.types import Group as Group
from sixflow.settings.types import Method as Method
from sixflow.settings.types import Reference as Reference
from sixflow.settings.types import SettingsOptions as SettingsOptions
