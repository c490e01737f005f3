"""The seam between `rso` and whatever computes: knobs, cases, responses, failures, capabilities and the run key.

A backend is any object with the attributes of :class:`Backend`.  It receives one value per knob and one
:class:`Case`, and returns a :class:`Response` or raises :class:`SimulationFailed`.  A run therefore ends

* **done**: a response;
* **failed**: the backend itself says that there is no answer (:class:`SimulationFailed`, with a cause class), or
  answers with what is no number (:class:`NotFinite`): what is finite is kept as a partial answer;
* **crashed**: anything else (another exception, a killed process, a time-out).  It is shown apart and tried
  again next time, so that a bug is never recorded as physics.

What it may know beside its answers (priors, alternatives, closed forms, costs, further tests) are the optional
protocols of `capabilities`, asked by :func:`capability`.

Units inside are N, mm, MPa, s.  This package needs numpy and the standard library only.
"""

from rso.contract.backend import Backend
from rso.contract.capabilities import (
    CAPABILITIES,
    ClosedForm,
    ClosedFormStart,
    ContactModulus,
    CostModel,
    DeformedBodies,
    DeformedBody,
    DeformedFrame,
    DeformedSurface,
    DerivedQuantities,
    DerivedQuantity,
    DistortionDepth,
    DraftSettings,
    Drawn,
    ErrorCalibration,
    Exports,
    FilledInputs,
    Fingerprint,
    ForceControl,
    ForceExponents,
    FormulaCurve,
    Formulas,
    FreeCurves,
    FurtherTests,
    Gauges,
    Given,
    LeanSettings,
    Line,
    ModelHierarchy,
    NewStudies,
    NominalValues,
    Option,
    OrdinaryMaterials,
    PhysicalBounds,
    PlausibleRanges,
    PreventableEffects,
    Reduction,
    Refusals,
    Relaxation,
    Resolution,
    Sketch,
    Sketches,
    SurfaceMarks,
    Variants,
    beyond_control,
    capability,
    lacking,
    unfit,
)
from rso.contract.cases import Case, Programme
from rso.contract.keys import run_key
from rso.contract.parameters import Parameter, Scope, drop_neutral, finite, knob, number, parameters_of, worded
from rso.contract.plain_data import by_contents, digest, object_path, plain
from rso.contract.responses import CAUSES, Curve, FreeCurve, NotFinite, Response, SimulationFailed
from rso.contract.segments import Segment

__all__ = [
    "CAPABILITIES",
    "CAUSES",
    "Backend",
    "Case",
    "ClosedForm",
    "ClosedFormStart",
    "ContactModulus",
    "CostModel",
    "Curve",
    "DeformedBodies",
    "DeformedBody",
    "DeformedFrame",
    "DeformedSurface",
    "DerivedQuantities",
    "DerivedQuantity",
    "DistortionDepth",
    "DraftSettings",
    "Drawn",
    "ErrorCalibration",
    "Exports",
    "FilledInputs",
    "Fingerprint",
    "ForceControl",
    "ForceExponents",
    "FormulaCurve",
    "Formulas",
    "FreeCurve",
    "FreeCurves",
    "FurtherTests",
    "Gauges",
    "Given",
    "LeanSettings",
    "Line",
    "ModelHierarchy",
    "NewStudies",
    "NominalValues",
    "NotFinite",
    "Option",
    "OrdinaryMaterials",
    "Parameter",
    "PhysicalBounds",
    "PlausibleRanges",
    "PreventableEffects",
    "Programme",
    "Reduction",
    "Refusals",
    "Relaxation",
    "Resolution",
    "Response",
    "Scope",
    "Segment",
    "SimulationFailed",
    "Sketch",
    "Sketches",
    "SurfaceMarks",
    "Variants",
    "beyond_control",
    "by_contents",
    "capability",
    "digest",
    "drop_neutral",
    "finite",
    "knob",
    "lacking",
    "number",
    "object_path",
    "parameters_of",
    "plain",
    "run_key",
    "unfit",
    "worded",
]
