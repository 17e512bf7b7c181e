"""All conditions by name."""

from __future__ import annotations

from benchmarks.honesty.benches import BENCHES
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.disturbed_worlds import DISTURBED
from benchmarks.honesty.sensor_defects import SENSORS
from benchmarks.honesty.starts import STARTS
from benchmarks.honesty.undisturbed import UNDISTURBED
from benchmarks.honesty.wrong_models import WRONG_MODELS

CONDITIONS: tuple[Condition, ...] = (*UNDISTURBED, *WRONG_MODELS, *SENSORS, *DISTURBED, *BENCHES)
CATALOGUE = {condition.name: condition for condition in (*CONDITIONS, *STARTS)}
if len(CATALOGUE) != len(CONDITIONS) + len(STARTS):
    raise ValueError('two conditions have one name')
