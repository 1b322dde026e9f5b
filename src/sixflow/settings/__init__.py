"""Settings: how a field is measured, checked when it is said.

| module | what |
|---|---|
| `settings` | `Settings`: one frozen dataclass = keyword arguments = command line = TOML file = attributes |
| `affine_guess` | a first guess of the motion, in numbers |
| `region` | the region of interest, a rectangle and polygons |
"""

from sixflow.settings.settings import WIDEST as WIDEST
from sixflow.settings.settings import Group as Group
from sixflow.settings.settings import Method as Method
from sixflow.settings.settings import Reference as Reference
from sixflow.settings.settings import Settings as Settings
from sixflow.settings.settings import SettingsOptions as SettingsOptions
from sixflow.settings.settings import require_names as require_names
from sixflow.settings.settings import require_settings as require_settings
