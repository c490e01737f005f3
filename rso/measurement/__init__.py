"""Measured curves: reading them, averaging repeats, and the measurement chain between the specimen and the file."""

from rso.measurement.chain import Chain, Record, correct, record, recorded
from rso.measurement.combining import MeasuredCurve, Noise, combine, value_at
from rso.measurement.reading import Measurement, Repeat, read

__all__ = [
    "Chain",
    "MeasuredCurve",
    "Measurement",
    "Noise",
    "Record",
    "Repeat",
    "combine",
    "correct",
    "read",
    "record",
    "recorded",
    "value_at",
]
