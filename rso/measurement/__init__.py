"""Measured curves: reading them, averaging repeats, and the measurement chain between the specimen and the file."""

from rso.measurement import usual
from rso.measurement.branches import SEGMENTS
from rso.measurement.cantilever import Unsaid
from rso.measurement.chain import CROSS, LATERAL, Chain, Record, correct, record, recorded, yielded
from rso.measurement.columns import CONTACT, Column
from rso.measurement.combining import MeasuredCurve, Noise, combine, value_at
from rso.measurement.pace import recorded_speed
from rso.measurement.reading import Measurement, Repeat, fingerprint, read
from rso.measurement.scatter import memory
from rso.measurement.spikes import kept, step_of, without_spikes
from rso.measurement.workbook import sheet_of

__all__ = [
    "CONTACT",
    "CROSS",
    "LATERAL",
    "SEGMENTS",
    "Chain",
    "Column",
    "MeasuredCurve",
    "Measurement",
    "Noise",
    "Record",
    "Repeat",
    "Unsaid",
    "combine",
    "correct",
    "fingerprint",
    "kept",
    "memory",
    "read",
    "record",
    "recorded",
    "recorded_speed",
    "sheet_of",
    "step_of",
    "usual",
    "value_at",
    "without_spikes",
    "yielded",
]
