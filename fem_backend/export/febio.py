"""An indentation as an input file of FEBio 4 (febio_spec 4.0)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from fem_backend.export.material_cards import MATERIAL_NAME, febio
from fem_backend.export.solid_model import SolidModel, sets_of

N_STEPS_PER_TRAVEL = 10  # between two asked travels, before FEBio chooses itself
MIN_STEP_RATIO = 2.0**-10  # of such a step: the smallest
FEBIO_PENALTY_FACTOR = 10.0  # times FEBio's automatic one
MULTIPLIER_TOLERANCE = 0.01  # augmentations end where multipliers change by less
LOG_FILE = "reaction.txt"  # of the force on the indenter


def febio_deck(model: SolidModel, remarks: Sequence[str]) -> str:
    """The whole file; its log `reaction.txt` holds z (mm) and Fx;Fy;Fz (N) of the rigid indenter at every step.

    Elements tet10, the indenter rigid tri3 and quad4 shells, sliding-elastic contact (augmented Lagrange) with
    Coulomb's friction, a load curve of travel over time whose must points are the asked moments.  The size of Fz times
    :attr:`SolidModel.share` is the force that the specimen puts on the indenter.

    Source: FEBio 4 source (FEBioXML/*Section4.cpp, FEBioMech/RigidBC.cpp, FESlidingElasticInterface.cpp).
    """
    root = Element("febio_spec", version="4.0")
    for line in remarks:
        root.append(ElementTree.Comment(f" {line.replace('--', '- -')} "))
    SubElement(root, "Module", type="solid")
    _control(root, model)
    materials = SubElement(root, "Material")
    for k, c in enumerate(model.materials):
        kind, parameters = febio(c)
        material = SubElement(materials, "material", id=str(k + 1), name=f"{MATERIAL_NAME}{k + 1}", type=kind)
        _texts(material, parameters.items())
    rigid = SubElement(materials, "material", id=str(len(model.materials) + 1), name="INDENTER", type="rigid body")
    _texts(rigid, [("density", "1"), ("center_of_mass", _triple(model.indenter.mean(0)))])
    _mesh(root, model)
    domains = SubElement(root, "MeshDomains")
    for k in range(len(model.materials)):
        SubElement(domains, "SolidDomain", name=f"Specimen{k + 1}", mat=f"{MATERIAL_NAME}{k + 1}")
    for name in _shells(model):
        SubElement(domains, "ShellDomain", name=name, mat="INDENTER")
    _conditions(root, model)
    data = SubElement(root, "LoadData")
    deepest = float(model.travel.max())
    _curve(data, 1, zip(model.time, model.travel / deepest, strict=True), "LINEAR")
    first = float(model.asked[0]) / N_STEPS_PER_TRAVEL
    gaps = np.diff(np.concatenate([[0.0], model.asked])) / N_STEPS_PER_TRAVEL
    _curve(data, 2, [(0.0, first), *zip(model.asked, gaps, strict=True)], "STEP")
    output = SubElement(root, "Output")
    plot = SubElement(output, "plotfile", type="febio")
    for name in ("displacement", "stress", "contact pressure"):
        SubElement(plot, "var", type=name)
    log = SubElement(output, "logfile")
    # FEBio keeps no reactions of nodes that are fixed, only of rigid bodies
    record = SubElement(log, "rigid_body_data", data="z;Fx;Fy;Fz", delim=",", file=LOG_FILE)
    record.text = str(len(model.materials) + 1)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _control(root: Element, model: SolidModel) -> None:
    step = float(np.diff(np.concatenate([[0.0], model.asked])).min()) / N_STEPS_PER_TRAVEL
    control = SubElement(root, "Control")
    end = float(model.time[-1])
    _texts(control, [("analysis", "STATIC"), ("time_steps", str(int(np.ceil(end / step - 1e-9))))])
    _texts(control, [("step_size", _number(step)), ("plot_level", "PLOT_MUST_POINTS")])
    solver = SubElement(control, "solver", type="solid")
    symmetric = "symmetric" if model.friction == 0.0 else "non-symmetric"
    _texts(solver, [("symmetric_stiffness", symmetric), ("max_refs", "30")])
    _texts(SubElement(solver, "qn_method", type="BFGS"), [("max_ups", "0")])
    stepper = SubElement(control, "time_stepper", type="default")
    _texts(stepper, [("max_retries", "10"), ("opt_iter", "15"), ("dtmin", _number(step * MIN_STEP_RATIO))])
    SubElement(stepper, "dtmax", lc="2").text = "1"


def _mesh(root: Element, model: SolidModel) -> None:
    mesh = SubElement(root, "Mesh")
    n, m = len(model.nodes), len(model.cells)
    nodes = SubElement(mesh, "Nodes", name="All")
    for k, x in enumerate(np.vstack([model.nodes, model.indenter]), 1):
        SubElement(nodes, "node", id=str(k)).text = _triple(x)
    for k in range(len(model.materials)):
        cells = np.flatnonzero(model.material == k)
        _elements(SubElement(mesh, "Elements", type="tet10", name=f"Specimen{k + 1}"), cells, model.cells[cells])
    start = m
    for name, faces in _shells(model).items():
        kind = "tri3" if faces.shape[1] == 3 else "quad4"
        ids = start + np.arange(len(faces))
        _elements(SubElement(mesh, "Elements", type=kind, name=name), ids, faces + n)
        start += len(faces)
    for k, (_, held) in enumerate(sets_of(model.fixed).items(), 1):
        SubElement(mesh, "NodeSet", name=f"Fixed{k}").text = _ids(held)
    surface = SubElement(mesh, "Surface", name="Top")
    for k, facet in enumerate(model.touching, 1):
        SubElement(surface, "tri6", id=str(k)).text = _ids(facet)
    tool = SubElement(mesh, "Surface", name="Tool")
    k = 0
    for faces in _shells(model).values():
        for face in faces:
            k += 1
            SubElement(tool, "tri3" if len(face) == 3 else "quad4", id=str(k)).text = _ids(face + n)
    pair = SubElement(mesh, "SurfacePair", name="Contact")
    _texts(pair, [("primary", "Top"), ("secondary", "Tool")])


def _shells(model: SolidModel) -> dict[str, np.ndarray]:
    """Triangles (t, 3) and quadrilaterals (q, 4) of the indenter by the name of their part."""
    flat = model.shell[:, 2] == model.shell[:, 3]
    found = {"IndenterTip": model.shell[flat, :3], "IndenterSide": model.shell[~flat]}
    return {name: faces for name, faces in found.items() if len(faces)}


def _conditions(root: Element, model: SolidModel) -> None:
    boundary = SubElement(root, "Boundary")
    for k, (kind, _) in enumerate(sets_of(model.fixed).items(), 1):
        bc = SubElement(boundary, "bc", name=f"Fix{k}", node_set=f"Fixed{k}", type="zero displacement")
        _texts(bc, ((f"{axis}_dof", str(int(held))) for axis, held in zip("xyz", kind, strict=True)))
    rigid, material = SubElement(root, "Rigid"), str(len(model.materials) + 1)
    moved = np.abs(model.way) > 1e-12
    bc = SubElement(rigid, "rigid_bc", name="Guide", type="rigid_fixed")
    dofs = [*zip(("Rx", "Ry", "Rz"), ~moved, strict=True), ("Ru", True), ("Rv", True), ("Rw", True)]
    _texts(bc, [("rb", material), *((f"{dof}_dof", str(int(held))) for dof, held in dofs)])
    deepest = float(model.travel.max())
    for axis in np.flatnonzero(moved):
        bc = SubElement(rigid, "rigid_bc", name=f"Press{'xyz'[axis]}", type="rigid_displacement")
        _texts(bc, [("rb", material), ("dof", "xyz"[axis])])
        SubElement(bc, "value", lc="1").text = _number(deepest * float(model.way[axis]))
        _texts(bc, [("relative", "0")])
    contact = SubElement(root, "Contact")
    sliding = SubElement(contact, "contact", type="sliding-elastic", name="Press", surface_pair="Contact")
    values = {"tolerance": MULTIPLIER_TOLERANCE, "penalty": FEBIO_PENALTY_FACTOR, "auto_penalty": 1, "two_pass": 0}
    values |= {"minaug": 1, "maxaug": 20, "fric_coeff": model.friction, "search_radius": float(np.ptp(model.indenter))}
    values |= {"symmetric_stiffness": int(model.friction == 0.0)}
    _texts(sliding, [("laugon", "AUGLAG"), *((k, _number(float(v))) for k, v in values.items())])


def _curve(parent: Element, number: int, points: Iterable[tuple[float, float]], interpolate: str) -> None:
    controller = SubElement(parent, "load_controller", id=str(number), type="loadcurve")
    _texts(controller, [("interpolate", interpolate), ("extend", "CONSTANT")])
    inner = SubElement(controller, "points")
    for t, v in points:
        SubElement(inner, "pt").text = f"{_number(float(t))},{_number(float(v))}"


def _elements(parent: Element, ids: np.ndarray, nodes: np.ndarray) -> None:
    for k, one in zip(ids, nodes, strict=True):
        SubElement(parent, "elem", id=str(int(k) + 1)).text = _ids(one)


def _texts(parent: Element, items: Iterable[tuple[str, str]]) -> None:
    for key, text in items:
        SubElement(parent, key).text = text


def _ids(nodes: np.ndarray) -> str:
    """Numbers of nodes, which begin with 1 there."""
    return ",".join(str(int(k) + 1) for k in nodes)


def _triple(x: np.ndarray) -> str:
    return ",".join(_number(float(v)) for v in x)


def _number(value: float) -> str:
    return f"{value + 0.0:.12g}"
