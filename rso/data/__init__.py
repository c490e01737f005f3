"""Measured curves: reading them, averaging repeats, and the measurement chain between the specimen and the file."""

from rso.data import usual_errors
from rso.data.branches import SEGMENTS
from rso.data.clouds import N_CLOUD_POINTS, SurfaceCloud, UnstatedNoise, cloud_curve, said_of_cloud, surface_cloud
from rso.data.creep import CreepHold, creep_curve, creep_of
from rso.data.drift import DriftAlong
from rso.data.files.cantilever import Unsaid
from rso.data.files.columns import ZERO_AT_CONTACT, Column, HeaderError
from rso.data.files.reading import Measurement, Repeat, fingerprint, read_measurement
from rso.data.files.workbook import sheet_of
from rso.data.holds import Hold, hold_of
from rso.data.instrument import CROSS_KNOBS, LATERAL_KNOBS, Chain, Record, correct, record, recorded_curve, yielded
from rso.data.loading_rate import recorded_speed
from rso.data.measured_curve import MeasuredCurve, Noise, StatedNoise
from rso.data.outliers import kept, step_of, without_spikes
from rso.data.repeats import combine, pulls_off, value_at
from rso.data.scatter import autocorrelation

__all__ = [
    "CROSS_KNOBS",
    "LATERAL_KNOBS",
    "N_CLOUD_POINTS",
    "SEGMENTS",
    "ZERO_AT_CONTACT",
    "Chain",
    "Column",
    "CreepHold",
    "DriftAlong",
    "HeaderError",
    "Hold",
    "MeasuredCurve",
    "Measurement",
    "Noise",
    "Record",
    "Repeat",
    "StatedNoise",
    "SurfaceCloud",
    "Unsaid",
    "UnstatedNoise",
    "autocorrelation",
    "cloud_curve",
    "combine",
    "correct",
    "creep_curve",
    "creep_of",
    "fingerprint",
    "hold_of",
    "kept",
    "pulls_off",
    "read_measurement",
    "record",
    "recorded_curve",
    "recorded_speed",
    "said_of_cloud",
    "sheet_of",
    "step_of",
    "surface_cloud",
    "usual_errors",
    "value_at",
    "without_spikes",
    "yielded",
]
