"""Chance: the one rate of false alarms (`sixflow.chance`), under the name that the tests of the field use."""

from sixflow.chance import FALSE_ALARMS as FALSE_ALARMS
from sixflow.chance import evidence_limit as evidence_limit
from sixflow.chance import normal_limit as normal_limit
